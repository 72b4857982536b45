/** Points of a PCD file as the service writes it: binary, three floats and a label each. */
export interface Cloud {
  /** x, y, z one after the other [m]. */
  xyz: Float32Array;
  centre: [number, number, number];
  low: [number, number, number];
  high: [number, number, number];
}

const MOST_POINTS = 200_000;

function headerOf(bytes: Uint8Array): { lines: Map<string, string>; offset: number } {
  const text = new TextDecoder("latin1").decode(bytes.subarray(0, 2048));
  const end = text.indexOf("DATA binary\n");
  if (end < 0) throw new Error("The points have an encoding that this page does not read.");
  const lines = new Map(text.slice(0, end).split("\n").map((line) => [line.split(" ")[0]!, line.split(" ").slice(1).join(" ")]));
  return { lines, offset: end + "DATA binary\n".length };
}

/** Read a cloud; of more than 200,000 points every n-th is kept. */
export function readCloud(buffer: ArrayBuffer): Cloud {
  const { lines, offset } = headerOf(new Uint8Array(buffer));
  const sizes = lines.get("SIZE")!.split(" ").map(Number);
  const stride = sizes.reduce((sum, size) => sum + size, 0);
  const points = Number(lines.get("POINTS"));
  const step = Math.max(1, Math.ceil(points / MOST_POINTS));
  const kept = Math.ceil(points / step);
  const view = new DataView(buffer, offset);
  const xyz = new Float32Array(kept * 3);
  const low: [number, number, number] = [Infinity, Infinity, Infinity];
  const high: [number, number, number] = [-Infinity, -Infinity, -Infinity];
  for (let k = 0; k < kept; k++) {
    for (let axis = 0; axis < 3; axis++) {
      const value = view.getFloat32(k * step * stride + axis * 4, true);
      xyz[k * 3 + axis] = value;
      if (value < low[axis]!) low[axis] = value;
      if (value > high[axis]!) high[axis] = value;
    }
  }
  const centre = low.map((value, axis) => (value + high[axis]!) / 2) as [number, number, number];
  return { xyz, centre, low, high };
}

export async function loadCloud(path: string): Promise<Cloud> {
  const answer = await fetch(path, { credentials: "same-origin" });
  if (!answer.ok) throw new Error(`${path}: ${answer.status}`);
  return readCloud(await answer.arrayBuffer());
}

export type Matrix = number[][];

export interface Pose {
  x: number;
  y: number;
  z: number;
  yaw: number;
}

export const poseOf = (T: Matrix): Pose => ({ x: T[0]![3]!, y: T[1]![3]!, z: T[2]![3]!, yaw: Math.atan2(T[1]![0]!, T[0]![0]!) });

export function matrixOf({ x, y, z, yaw }: Pose): Matrix {
  const [c, s] = [Math.cos(yaw), Math.sin(yaw)];
  return [[c, -s, 0, x], [s, c, 0, y], [0, 0, 1, z], [0, 0, 0, 1]];
}

/** Move and turn a pose in the map; it is turned about the point that `pivot` of the scan is at. */
export function moved(T: Matrix, by: { x: number; y: number; yaw: number }, pivot: readonly [number, number, number]): Matrix {
  const [c, s] = [Math.cos(by.yaw), Math.sin(by.yaw)];
  const px = T[0]![0]! * pivot[0] + T[0]![1]! * pivot[1] + T[0]![2]! * pivot[2] + T[0]![3]!;
  const py = T[1]![0]! * pivot[0] + T[1]![1]! * pivot[1] + T[1]![2]! * pivot[2] + T[1]![3]!;
  const [rowX, rowY] = [T[0]!, T[1]!];
  const turnedX = rowX.map((value, k) => c * value - s * rowY[k]!);
  const turnedY = rowX.map((value, k) => s * value + c * rowY[k]!);
  turnedX[3] = px + c * (rowX[3]! - px) - s * (rowY[3]! - py) + by.x;
  turnedY[3] = py + s * (rowX[3]! - px) + c * (rowY[3]! - py) + by.y;
  return [turnedX, turnedY, [...T[2]!], [...T[3]!]];
}
