/** A reading as strokes: what was kept as walls, and what was set aside; and the way to the file's own coordinates. */
import { get, type Drawing, type Likely, type Reading } from "../api/client";
import type { Features, Point, StrokeFeature, StrokeLayer } from "../api/told";

export interface Stroke {
  id: string;
  /** `wall` and `column` are kept, every other layer is set aside. */
  layer: StrokeLayer;
  reason: string;
  lines: Point[][];
  closed: boolean;
  low: Point;
  high: Point;
}

export const KEPT: readonly StrokeLayer[] = ["wall", "column"];
/** What a stroke is hidden by besides its layer. */
export const reasonOf = (stroke: Stroke): string => `${stroke.layer}: ${stroke.reason}`;
export const isHidden = (stroke: Stroke, hidden: ReadonlySet<string>): boolean =>
  hidden.has(stroke.layer) || hidden.has(reasonOf(stroke));
export const isKept = (stroke: Stroke): boolean => KEPT.includes(stroke.layer);

function linesOf({ geometry, properties }: StrokeFeature): { lines: Point[][]; closed: boolean } {
  if (properties.faces?.length === 2)
    return { lines: [[...properties.faces[0]!, ...[...properties.faces[1]!].reverse()]], closed: true };
  if (geometry.type === "LineString") return { lines: [geometry.coordinates as Point[]], closed: false };
  return { lines: geometry.coordinates as Point[][], closed: geometry.type === "Polygon" };
}

function strokeOf(feature: StrokeFeature): Stroke {
  const { lines, closed } = linesOf(feature);
  const [low, high]: [Point, Point] = [
    [Infinity, Infinity],
    [-Infinity, -Infinity],
  ];
  for (const line of lines)
    for (const at of line)
      for (const axis of [0, 1] as const) {
        low[axis] = Math.min(low[axis], at[axis]);
        high[axis] = Math.max(high[axis], at[axis]);
      }
  const { id, layer, reason } = feature.properties;
  return { id, layer, reason, lines, closed, low, high };
}

export async function loadStrokes(drawing: Drawing): Promise<Stroke[]> {
  const files = [drawing.files.removed, drawing.files.walls].filter((path): path is string => !!path);
  const read = await Promise.all(files.map((path) => get<Features<StrokeFeature>>(path)));
  return read.flatMap((collection) => collection.features.map(strokeOf));
}

/** What of a reading tells where its frame lies in the file. */
export type Framed = Pick<Reading, "scale" | "drawing_origin" | "drawing_top">;
const factorOf = (reading: Framed) => reading.scale?.metres_per_unit ?? 1;

/** Width and height of the sheet. */
export function sizeOf({ sheet }: Pick<Reading, "sheet">): Point {
  const [width = 1, height = 1] = sheet ?? [];
  return [width, height];
}

/** A point of frame `drawing` in the file's own coordinates. */
export function toFile(reading: Framed, [x, y]: Point): Point {
  const [ox = 0, oy = 0] = reading.drawing_origin ?? [];
  const up = reading.drawing_top === null ? y + oy : reading.drawing_top - y;
  return [(x + ox) / factorOf(reading), up / factorOf(reading)];
}

/** A point of the file in frame `drawing`. */
export function toDrawing(reading: Framed, [x, y]: readonly number[] | Point): Point {
  const [ox = 0, oy = 0] = reading.drawing_origin ?? [];
  const [fx, fy] = [x * factorOf(reading), y * factorOf(reading)];
  return [fx - ox, reading.drawing_top === null ? fy - oy : reading.drawing_top - fy];
}

/** By how much a witness differs from a scale [%]: 0 where what it holds likely has the scale in it. */
export function offBy(metresPerUnit: number, likely: Likely): number {
  const range = typeof likely === "number" ? [likely] : likely;
  const nearest = Math.min(Math.max(...range), Math.max(Math.min(...range), metresPerUnit));
  return 100 * (nearest / metresPerUnit - 1);
}

function isInside(ring: readonly Point[], [x, y]: Point): boolean {
  let inside = false;
  for (let k = 0, before = ring.length - 1; k < ring.length; before = k++) {
    const [[ax, ay], [bx, by]] = [ring[k]!, ring[before]!];
    if (ay > y !== by > y && x < ((bx - ax) * (y - ay)) / (by - ay) + ax) inside = !inside;
  }
  return inside;
}

const SAMPLES = 8;

/** Whether more than half of a stroke lies in a polygon, as the service asks it, by samples along its lines. */
export function mostlyInside(stroke: Stroke, ring: readonly Point[]): boolean {
  let [inside, all] = [0, 0];
  for (const line of stroke.lines) {
    for (let k = 0; k + 1 < line.length; k++) {
      const [[ax, ay], [bx, by]] = [line[k]!, line[k + 1]!];
      const far = Math.hypot(bx - ax, by - ay);
      for (let s = 0; s < SAMPLES; s++) {
        const share = (s + 0.5) / SAMPLES;
        all += far;
        if (isInside(ring, [ax + (bx - ax) * share, ay + (by - ay) * share])) inside += far;
      }
    }
  }
  return all > 0 && inside > all / 2;
}
