/** How far a placed scan's points lie from the faces of the walls, as colours. */
import type { Features, Matrix, Point, WallFeature } from "../api/told";
import type { Cloud } from "./cloud";

export const RESIDUALS = [
  { upTo: 0.02, colour: "#1a9850", label: "place.within2" },
  { upTo: 0.05, colour: "#b59a00", label: "place.within5" },
  { upTo: 0.1, colour: "#8e44ad", label: "place.within10" },
] as const;
export const OFF_COLOUR = "#ff6a13";

const REACH_M = RESIDUALS[RESIDUALS.length - 1]!.upTo;
const CELL_M = 0.5;
const FLOOR_M = 0.1;

/** The faces of walls and columns, seen from above, found by place. */
export class Faces {
  private readonly cells = new Map<string, [Point, Point][]>();

  constructor(collection: Features<WallFeature>) {
    for (const { geometry, properties } of collection.features) {
      const lines = properties.faces ?? (geometry.type === "Polygon" ? (geometry.coordinates as Point[][]) : []);
      for (const line of lines) for (let k = 1; k < line.length; k++) this.add(line[k - 1]!, line[k]!);
    }
  }

  /** Distance to the nearest face [m]; Infinity where none is within 10 cm. */
  distance(x: number, y: number): number {
    let least = Infinity;
    for (const [a, b] of this.cells.get(nameOf(x, y)) ?? []) least = Math.min(least, offOf(x, y, a, b));
    return least <= REACH_M ? least : Infinity;
  }

  private add(a: Point, b: Point): void {
    const steps = Math.max(1, Math.ceil(Math.hypot(b[0] - a[0], b[1] - a[1]) / (CELL_M / 4)));
    const names = new Set<string>();
    for (let step = 0; step <= steps; step++) {
      const [x, y] = [a[0] + ((b[0] - a[0]) * step) / steps, a[1] + ((b[1] - a[1]) * step) / steps];
      for (const dx of [-1, 0, 1])
        for (const dy of [-1, 0, 1]) names.add(nameOf(x + dx * 2 * REACH_M, y + dy * 2 * REACH_M));
    }
    for (const name of names) {
      const held = this.cells.get(name);
      if (held) held.push([a, b]);
      else this.cells.set(name, [[a, b]]);
    }
  }
}

const nameOf = (x: number, y: number) => `${Math.floor(x / CELL_M)},${Math.floor(y / CELL_M)}`;

function offOf(x: number, y: number, [ax, ay]: Point, [bx, by]: Point): number {
  const [dx, dy] = [bx - ax, by - ay];
  const share = Math.min(1, Math.max(0, ((x - ax) * dx + (y - ay) * dy) / Math.max(1e-12, dx * dx + dy * dy)));
  return Math.hypot(x - ax - share * dx, y - ay - share * dy);
}

const channels = (colour: string): number[] => [1, 3, 5].map((at) => Number.parseInt(colour.slice(at, at + 2), 16));

/** Red, green and blue of each point of a scan that lies at `T`; what is no wall, or lies at the floor, is orange. */
export function residualColours(faces: Faces, { xyz }: Cloud, T: Matrix, floor: number): Uint8Array {
  const bands = RESIDUALS.map(({ upTo, colour }) => ({ upTo, rgb: channels(colour) }));
  const off = channels(OFF_COLOUR);
  const colours = new Uint8Array(xyz.length);
  for (let k = 0; k < xyz.length; k += 3) {
    const [x, y, z] = [0, 1, 2].map(
      (row) => T[row]![0]! * xyz[k]! + T[row]![1]! * xyz[k + 1]! + T[row]![2]! * xyz[k + 2]! + T[row]![3]!,
    ) as [number, number, number];
    const distance = z > floor + FLOOR_M ? faces.distance(x, y) : Infinity;
    colours.set(bands.find(({ upTo }) => distance <= upTo)?.rgb ?? off, k);
  }
  return colours;
}
