import type { Features, OctreeTold, SheetTold, StrokeFeature, WallFeature } from "../src/api/told";

/** At least the members of `T`, at every depth. */
type AtLeast<T> = T extends readonly unknown[]
  ? { [K in keyof T]: AtLeast<T[K]> }
  : T extends object
    ? { [K in keyof T]: AtLeast<T[K]> } & Record<string, unknown>
    : T;

/** What `told.ts` holds: what the service tells has at least what the pages read of it. */
export interface Told {
  strokes: AtLeast<Features<StrokeFeature>>[];
  walls: AtLeast<Features<WallFeature>>[];
  octrees: AtLeast<OctreeTold>[];
  sheets: AtLeast<SheetTold>[];
}
