/** Lines over a stage seen from above: how sure a pose is, and regions that a person has drawn. */
import type { Evidence } from "../api/client";
import { BufferGeometry, Group, LineBasicMaterial, LineLoop, Vector3 } from "three";

export type At = [number, number];

export interface Outline {
  corners: readonly At[];
  colour: string;
}

export const ELLIPSE_TIMES = 50;
const CORNERS = 64;
/** Of a chi-squared variable with two degrees of freedom, 95 % lie below it. */
const CHI2_95 = 5.991;
const HEIGHT_M = 50;

export interface Ellipse {
  /** Half axes [m] of the 95 % ellipse in x and y, the larger first. */
  half: [number, number];
  /** Direction of the larger one [rad]. */
  angle: number;
}

/** The ellipse that holds the true place in 95 of 100 cases, of a covariance in x and y; null where none is told. */
export function ellipseOf({ covariance: rows }: Pick<Evidence, "covariance">): Ellipse | null {
  const [xx, xy, yy] = [rows?.[0]?.[0], rows?.[0]?.[1], rows?.[1]?.[1]];
  if (typeof xx !== "number" || typeof xy !== "number" || typeof yy !== "number") return null;
  const [middle, apart] = [(xx + yy) / 2, Math.hypot((xx - yy) / 2, xy)];
  const half = [middle + apart, Math.max(0, middle - apart)].map((variance) => Math.sqrt(CHI2_95 * variance)) as [
    number,
    number,
  ];
  return { half, angle: Math.atan2(2 * xy, xx - yy) / 2 };
}

/** The corners of an ellipse, fifty times as large so that it can be seen, around a place. */
export function cornersOf({ half, angle }: Ellipse, at: At): At[] {
  return Array.from({ length: CORNERS }, (_, k) => {
    const [u, v] = [
      half[0] * ELLIPSE_TIMES * Math.cos((2 * Math.PI * k) / CORNERS),
      half[1] * ELLIPSE_TIMES * Math.sin((2 * Math.PI * k) / CORNERS),
    ];
    return [at[0] + u * Math.cos(angle) - v * Math.sin(angle), at[1] + u * Math.sin(angle) + v * Math.cos(angle)];
  });
}

export class Outlines {
  readonly group = new Group();
  private loops: LineLoop<BufferGeometry, LineBasicMaterial>[] = [];

  show(outlines: readonly Outline[]): void {
    this.leave();
    for (const { corners, colour } of outlines) {
      const geometry = new BufferGeometry().setFromPoints(corners.map(([x, y]) => new Vector3(x, y, HEIGHT_M)));
      const loop = new LineLoop(geometry, new LineBasicMaterial({ color: colour, depthTest: false }));
      loop.renderOrder = 2;
      this.loops.push(loop);
      this.group.add(loop);
    }
  }

  leave(): void {
    for (const loop of this.loops) {
      loop.geometry.dispose();
      loop.material.dispose();
    }
    this.loops = [];
    this.group.clear();
  }
}
