/** The walls of a revision, on which a place and a direction are tapped. */
import { useRef } from "preact/hooks";
import type { Rough } from "../api/parcels";
import type { Features, WallFeature } from "../api/told";

type Ring = [number, number][];

export interface Walls {
  rings: Ring[];
  low: [number, number];
  high: [number, number];
}

const isPoint = (value: unknown): value is [number, number] => Array.isArray(value) && typeof value[0] === "number";

function ringsOf(coordinates: unknown): Ring[] {
  const parts = coordinates as unknown[];
  return parts.length > 0 && isPoint(parts[0]) ? [parts as Ring] : parts.flatMap(ringsOf);
}

export function wallsOf(collection: Features<WallFeature>): Walls {
  const rings = collection.features.flatMap((one) => ringsOf(one.geometry.coordinates));
  const all = rings.flat();
  const bound = (axis: 0 | 1, pick: (a: number, b: number) => number, from: number) =>
    all.reduce((found, at) => pick(found, at[axis]), from);
  return {
    rings,
    low: [bound(0, Math.min, Infinity), bound(1, Math.min, Infinity)],
    high: [bound(0, Math.max, -Infinity), bound(1, Math.max, -Infinity)],
  };
}

interface TapPlanProps {
  walls: Walls;
  value: Rough | null;
  turned: boolean;
  set: (value: Rough, turned: boolean) => void;
  label: string;
}

/** The first tap says where, the second in which direction; a third begins anew. */
export function TapPlan({ walls, value, turned, set, label }: TapPlanProps) {
  const picture = useRef<SVGSVGElement>(null);
  const size = Math.max(walls.high[0] - walls.low[0], walls.high[1] - walls.low[1], 1);
  const margin = size * 0.04;
  const box = [
    walls.low[0] - margin,
    -walls.high[1] - margin,
    walls.high[0] - walls.low[0] + 2 * margin,
    walls.high[1] - walls.low[1] + 2 * margin,
  ];
  const tapped = (event: MouseEvent) => {
    const at = new DOMPoint(event.clientX, event.clientY).matrixTransform(picture.current!.getScreenCTM()!.inverse());
    const [x, y] = [at.x, -at.y];
    if (value && !turned) set({ ...value, yaw_rad: Math.atan2(y - value.y_m, x - value.x_m) }, true);
    else set({ x_m: x, y_m: y, yaw_rad: 0 }, false);
  };
  const path = walls.rings
    .map((ring) => `M${ring.map(([x, y]) => `${x.toFixed(3)} ${(-y).toFixed(3)}`).join("L")}Z`)
    .join("");
  return (
    <svg ref={picture} class="tap-plan" viewBox={box.join(" ")} role="img" aria-label={label} onClick={tapped}>
      <path d={path} fill-rule="evenodd" class="walls" stroke-width={size / 400} />
      {value && (
        <g transform={`translate(${value.x_m} ${-value.y_m}) rotate(${(-value.yaw_rad * 180) / Math.PI})`}>
          {turned && <path d={`M0 0L${size * 0.1} ${-size * 0.045}V${size * 0.045}Z`} class="looks" />}
          <circle r={size * 0.02} class="stands" />
        </g>
      )}
    </svg>
  );
}
