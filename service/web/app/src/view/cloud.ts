/** Points of a PCD file as the service writes it: binary, three floats and a label each. */
import type { Matrix } from "../api/told";

export interface Cloud {
  /** x, y, z one after the other [m]. */
  xyz: Float32Array;
  centre: [number, number, number];
  low: [number, number, number];
  high: [number, number, number];
}

const MOST_POINTS = 200_000;

interface Header {
  stride: number;
  points: number;
  offset: number;
}

function headerOf(bytes: Uint8Array): Header | null {
  const text = new TextDecoder("latin1").decode(bytes.subarray(0, 2048));
  const end = text.indexOf("DATA binary\n");
  if (end < 0 && bytes.length < 2048) return null;
  if (end < 0) throw new Error("The points have an encoding that this page does not read.");
  const lines = new Map(
    text
      .slice(0, end)
      .split("\n")
      .map((line) => [line.split(" ")[0]!, line.split(" ").slice(1).join(" ")]),
  );
  const stride = lines
    .get("SIZE")!
    .split(" ")
    .map(Number)
    .reduce((sum, size) => sum + size, 0);
  return { stride, points: Number(lines.get("POINTS")), offset: end + "DATA binary\n".length };
}

function joined(left: Uint8Array, right: Uint8Array): Uint8Array {
  const both = new Uint8Array(left.length + right.length);
  both.set(left);
  both.set(right, left.length);
  return both;
}

/** Points as their bytes arrive: no more is held than what is kept; of too many points every n-th is. */
class Gathered {
  private readonly step: number;
  private readonly xyz: Float32Array;
  private readonly low: [number, number, number] = [Infinity, Infinity, Infinity];
  private readonly high: [number, number, number] = [-Infinity, -Infinity, -Infinity];
  private seen = 0;
  private kept = 0;

  constructor(
    private readonly header: Header,
    most: number,
  ) {
    this.step = Math.max(1, Math.ceil(header.points / most));
    this.xyz = new Float32Array(Math.ceil(header.points / this.step) * 3);
  }

  /** Take the whole points in `bytes`; give back what is left of the last one. */
  take(bytes: Uint8Array): Uint8Array {
    const { stride, points } = this.header;
    const whole = Math.min(Math.floor(bytes.length / stride), points - this.seen);
    const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
    for (let k = (this.step - (this.seen % this.step)) % this.step; k < whole; k += this.step) {
      for (let axis = 0; axis < 3; axis++) {
        const value = view.getFloat32(k * stride + axis * 4, true);
        this.xyz[this.kept * 3 + axis] = value;
        if (value < this.low[axis]!) this.low[axis] = value;
        if (value > this.high[axis]!) this.high[axis] = value;
      }
      this.kept += 1;
    }
    this.seen += whole;
    return bytes.slice(whole * stride);
  }

  cloud(): Cloud {
    if (this.seen < this.header.points) throw new Error("The points ended too early: load the page again.");
    const centre = this.low.map((value, axis) => (value + this.high[axis]!) / 2) as [number, number, number];
    return { xyz: this.xyz, centre, low: this.low, high: this.high };
  }
}

/** Load a cloud piece by piece; of more than `most` points every n-th is kept, the others are never held. */
export async function loadCloud(path: string, most = MOST_POINTS): Promise<Cloud> {
  const answer = await fetch(path, { credentials: "same-origin" });
  if (!answer.ok) throw new Error(`${path}: ${answer.status}`);
  const reader = answer.body!.getReader();
  let left: Uint8Array = new Uint8Array(0);
  let gathered: Gathered | null = null;
  for (let piece = await reader.read(); !piece.done; piece = await reader.read()) {
    left = joined(left, piece.value);
    if (!gathered) {
      const header = headerOf(left);
      if (!header) continue;
      gathered = new Gathered(header, most);
      left = left.subarray(header.offset);
    }
    left = gathered.take(left);
  }
  if (!gathered) throw new Error("The points have an encoding that this page does not read.");
  return gathered.cloud();
}

export interface Pose {
  x: number;
  y: number;
  z: number;
  yaw: number;
}

export const poseOf = (T: Matrix): Pose => ({
  x: T[0]![3]!,
  y: T[1]![3]!,
  z: T[2]![3]!,
  yaw: Math.atan2(T[1]![0]!, T[0]![0]!),
});

export function matrixOf({ x, y, z, yaw }: Pose): Matrix {
  const [c, s] = [Math.cos(yaw), Math.sin(yaw)];
  return [
    [c, -s, 0, x],
    [s, c, 0, y],
    [0, 0, 1, z],
    [0, 0, 0, 1],
  ];
}

/** Move and turn a pose in the map; it is turned about the point that `pivot` of the scan is at. */
export function moved(
  T: Matrix,
  by: { x: number; y: number; yaw: number },
  pivot: readonly [number, number, number],
): Matrix {
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
