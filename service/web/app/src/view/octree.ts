/** A revision's cloud in levels of detail, as the service writes it: `octree.json` and parts of `octree.bin`. */
import { Refused, send } from "../api/client";
import type { OctreeTold } from "../api/told";
import { loadCloud, type Cloud } from "./cloud";

const RECORD_BYTES = 8;
const STEPS = 65_535;
const OVERVIEW_POINTS = 60_000;

export interface OctreeNode {
  low: [number, number, number];
  edge: number;
  /** Its first point among all. */
  begin: number;
  count: number;
  children: OctreeNode[];
}

/** Four uint16 a point: x, y and z within the node's cube, and the label. */
export type Records = Uint16Array;

/** What a page shows of a map: some of its points at once, and where the others are. */
export interface MapCloud {
  overview: Cloud;
  /** Null where a revision was built without levels: then the overview, thinned, is all there is. */
  octree: Octree | null;
  /** The coarsest nodes, whose points are the overview. */
  first: readonly (readonly [OctreeNode, Records])[];
}

export const placeOf = (node: OctreeNode, records: Records, k: number, axis: number): number =>
  node.low[axis]! + (records[4 * k + axis]! / STEPS) * node.edge;

function tree({ low_m, edge_m, nodes }: OctreeTold): { root: OctreeNode; inOrder: OctreeNode[] } {
  const byPlace = new Map<string, OctreeNode>();
  const at = (depth: number, x: number, y: number, z: number): OctreeNode => {
    const name = `${depth}/${x}/${y}/${z}`;
    const known = byPlace.get(name);
    if (known) return known;
    const edge = edge_m / 2 ** depth;
    const low = [x, y, z].map((index, axis) => low_m[axis]! + index * edge) as [number, number, number];
    const made: OctreeNode = { low, edge, begin: 0, count: 0, children: [] };
    byPlace.set(name, made);
    if (depth > 0) at(depth - 1, x >> 1, y >> 1, z >> 1).children.push(made);
    return made;
  };
  const root = at(0, 0, 0, 0);
  let begin = 0;
  const inOrder = nodes.map(([depth, x, y, z, count]) => {
    const node = at(depth, x, y, z);
    Object.assign(node, { begin, count });
    begin += count;
    return node;
  });
  return { root, inOrder };
}

/** The nodes of whole levels, as many as an overview may have points; the first level at least. */
function coarsest(depths: readonly number[], inOrder: readonly OctreeNode[]): OctreeNode[] {
  let [points, whole] = [0, 0];
  for (let k = 0; k < inOrder.length; k++) {
    points += inOrder[k]!.count;
    if (points > OVERVIEW_POINTS && whole > 0) break;
    if (depths[k + 1] !== depths[k]) whole = k + 1;
  }
  return inOrder.slice(0, whole);
}

export class Octree {
  private constructor(
    private readonly path: string,
    readonly root: OctreeNode,
  ) {}

  /** Open a revision's cloud: its coarsest nodes are loaded at once; one without levels is loaded thinned. */
  static async open(artifacts: string): Promise<MapCloud> {
    let told: OctreeTold;
    try {
      told = (await (await send("GET", `${artifacts}/octree.json`)).json()) as OctreeTold;
    } catch (cause) {
      if (cause instanceof Refused && cause.status === 404)
        return { overview: await loadCloud(`${artifacts}/point-cloud.pcd`), octree: null, first: [] };
      throw cause;
    }
    const { root, inOrder } = tree(told);
    const octree = new Octree(`${artifacts}/octree.bin`, root);
    const first = coarsest(
      told.nodes.map(([depth]) => depth),
      inOrder,
    );
    const points = first.reduce((sum, node) => sum + node.count, 0);
    const { min, max } = told.extent_m;
    const xyz = new Float32Array(3 * points);
    const centre = min.map((value, axis) => (value + max[axis]!) / 2) as [number, number, number];
    const records = await octree.part(0, points);
    const loaded = first.map(
      (node) => [node, records.subarray(4 * node.begin, 4 * (node.begin + node.count))] as const,
    );
    for (const [node, own] of loaded) {
      for (let k = 0; k < node.count; k++)
        for (let axis = 0; axis < 3; axis++) xyz[3 * (node.begin + k) + axis] = placeOf(node, own, k, axis);
    }
    return { overview: { xyz, centre, low: min, high: max }, octree, first: loaded };
  }

  /** Load a node's points. */
  load(node: OctreeNode, signal?: AbortSignal): Promise<Records> {
    return this.part(node.begin, node.count, signal);
  }

  private async part(begin: number, count: number, signal?: AbortSignal): Promise<Records> {
    const range = `bytes=${begin * RECORD_BYTES}-${(begin + count) * RECORD_BYTES - 1}`;
    const answer = await send("GET", this.path, { headers: { Range: range }, signal: signal ?? null });
    return new Uint16Array(await answer.arrayBuffer());
  }
}
