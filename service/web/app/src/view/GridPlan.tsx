/** A revision from above in metres, over which a page draws what it is about. */
import type { ComponentChildren } from "preact";
import { useEffect, useRef } from "preact/hooks";
import type { Grid } from "./grid";

export type Point = [number, number];

export interface Extent {
  low: Point;
  high: Point;
}

export const extentOf = (grids: readonly Extent[]): Extent => ({
  low: [Math.min(...grids.map((one) => one.low[0])), Math.min(...grids.map((one) => one.low[1]))],
  high: [Math.max(...grids.map((one) => one.high[0])), Math.max(...grids.map((one) => one.high[1]))],
});

/** One grid as a canvas that fills its parent's extent. */
export function GridPicture({ grid, extent, clip }: { grid: Grid; extent: Extent; clip?: string }) {
  const canvas = useRef<HTMLCanvasElement>(null);
  useEffect(() => {
    const node = canvas.current!;
    node.width = grid.picture.width;
    node.height = grid.picture.height;
    node.getContext("2d")!.putImageData(grid.picture, 0, 0);
    const [wide, high] = [extent.high[0] - extent.low[0], extent.high[1] - extent.low[1]];
    const per = (metres: number, whole: number) => `${(100 * metres) / whole}%`;
    Object.assign(node.style, {
      left: per(grid.low[0] - extent.low[0], wide),
      top: per(extent.high[1] - grid.high[1], high),
      width: per(grid.high[0] - grid.low[0], wide),
      height: per(grid.high[1] - grid.low[1], high),
    });
  }, [grid, extent]);
  return <canvas ref={canvas} class={`grid-picture ${clip ?? ""}`} />;
}

interface GridPlanProps {
  grid: Grid;
  label: string;
  /** Called with a place in frame `map` [m]. */
  tapped?: (at: Point) => void;
  children?: ComponentChildren;
}

/** The SVG over the picture has metres as its unit; y is turned over. */
export function GridPlan({ grid, label, tapped, children }: GridPlanProps) {
  const overlay = useRef<SVGSVGElement>(null);
  const [wide, high] = [grid.high[0] - grid.low[0], grid.high[1] - grid.low[1]];
  const tap = (event: MouseEvent) => {
    const at = new DOMPoint(event.clientX, event.clientY).matrixTransform(overlay.current!.getScreenCTM()!.inverse());
    tapped?.([at.x, -at.y]);
  };
  return (
    <div
      class="grid-plan"
      ref={(node) => {
        if (node) node.style.aspectRatio = `${wide} / ${high}`;
      }}
    >
      <GridPicture grid={grid} extent={grid} />
      <svg
        ref={overlay}
        viewBox={`${grid.low[0]} ${-grid.high[1]} ${wide} ${high}`}
        role="img"
        aria-label={label}
        onClick={tap}
      >
        {children}
      </svg>
    </div>
  );
}

/** Corners as an SVG's `points`. */
export const cornersOf = (within: readonly (readonly number[])[]): string =>
  within.map(([x, y]) => `${x},${-y!}`).join(" ");
