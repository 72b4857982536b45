/**
 * What the service tells beside its API's description: its files.
 * The types name what the pages read; `tests/told.ts` holds what the service does tell, and has to be of them.
 */
import type { components } from "./schema";

export type Point = [number, number];
export type Edit = NonNullable<components["schemas"]["DrawingPatch"]["edits"]>[number];
export type StrokeLayer = Extract<Edit, { action: "move" }>["to"];

/** 4 x 4, row by row. */
export type Matrix = number[][];

export interface Features<F> {
  features: F[];
}

/** Of a drawing's `walls.geojson` and `removed.geojson`. */
export interface StrokeFeature {
  geometry: { type: "LineString" | "MultiLineString" | "Polygon"; coordinates: Point[] | Point[][] };
  properties: { id: string; layer: StrokeLayer; reason: string; faces?: Point[][] };
}

/** Of a revision's `walls.geojson`. */
export interface WallFeature {
  geometry: { type: "LineString" | "Polygon"; coordinates: Point[] | Point[][] };
  properties: { faces?: Point[][] };
}

/** A revision's `octree.json`. */
export interface OctreeTold {
  points: number;
  low_m: [number, number, number];
  edge_m: number;
  extent_m: { min: [number, number, number]; max: [number, number, number] };
  nodes: [depth: number, x: number, y: number, z: number, count: number][];
}

/** A drawing's `sheet.json`. */
export interface SheetTold {
  size_px: [number, number];
  tile_px: number;
  levels: number;
  sha256: string;
  tiles: [level: number, column: number, row: number, bytes: number][];
}
