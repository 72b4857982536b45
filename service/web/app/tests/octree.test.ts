import { expect, test } from "vitest";
import { Octree, placeOf, type OctreeNode } from "../src/view/octree";
import { files, serve } from "./serving";
import { told } from "./told";

const AT = "/v1/maps/m/revisions/1/artifacts";
const EDGE = 8;
/** A root of one point, and two levels under one corner of it. */
const TOLD = {
  points: 5,
  low_m: [-4, 10, 0],
  edge_m: EDGE,
  extent_m: { min: [-4, 10, 0], max: [4, 18, 8] },
  nodes: [
    [0, 0, 0, 0, 1],
    [1, 1, 0, 0, 2],
    [2, 3, 1, 0, 2],
  ],
};
const RECORDS = new Uint16Array(TOLD.points * 4).map((_, k) => (k % 4 === 3 ? 0 : Math.floor(k / 4) * 13_107));

const served = (json: unknown, binary: Uint16Array) =>
  serve(files({ [`${AT}/octree.json`]: JSON.stringify(json), [`${AT}/octree.bin`]: new Uint8Array(binary.buffer) }));

const every = (node: OctreeNode): OctreeNode[] => [node, ...node.children.flatMap(every)];

test("nodes know their cubes, their parents, and which points are theirs", async () => {
  await served(TOLD, RECORDS);
  const { octree } = await Octree.open(AT);
  const [root, child, grandchild] = every(octree!.root);
  expect(root).toMatchObject({ low: [-4, 10, 0], edge: 8, begin: 0, count: 1 });
  expect(child).toMatchObject({ low: [0, 10, 0], edge: 4, begin: 1, count: 2 });
  expect(grandchild).toMatchObject({ low: [2, 12, 0], edge: 2, begin: 3, count: 2 });
});

test("a node's points are fetched as its part of the file, and lie in its cube", async () => {
  const asked = await served(TOLD, RECORDS);
  const { octree } = await Octree.open(AT);
  const node = every(octree!.root)[2]!;
  const records = await octree!.load(node);
  expect(asked.at(-1)!.headers.range).toBe("bytes=24-39");
  expect([...records]).toEqual([...RECORDS.subarray(12, 20)]);
  expect(placeOf(node, records, 0, 0)).toBeCloseTo(2 + (3 * 13_107 * 2) / 65_535, 9);
  expect(placeOf(node, new Uint16Array([0, 65_535, 0, 0]), 0, 1)).toBe(14);
});

test("the overview is whole levels, as many as it may have points", async () => {
  const nodes = [
    [0, 0, 0, 0, 100],
    [1, 0, 0, 0, 30_000],
    [1, 1, 0, 0, 20_000],
    [2, 0, 0, 0, 15_000],
    [2, 1, 0, 0, 5_000],
  ];
  const points = 70_100;
  await served({ ...TOLD, points, nodes }, new Uint16Array(points * 4));
  const { overview, first } = await Octree.open(AT);
  expect(first.map(([node]) => node.count)).toEqual([100, 30_000, 20_000]);
  expect(overview.xyz).toHaveLength(3 * 50_100);
});

test("what the service writes is read", async () => {
  const [octree] = told.octrees;
  await served(octree, new Uint16Array(octree!.points * 4));
  const { overview } = await Octree.open(AT);
  expect(overview.xyz).toHaveLength(3 * octree!.points);
  expect(overview.low).toEqual([0, 0, 0]);
  expect(overview.high).toEqual([3, 2, 1]);
});

test("a revision without levels is loaded as a cloud, one that is refused is not", async () => {
  const pcd = "VERSION .7\nFIELDS x y z label\nSIZE 4 4 4 4\nPOINTS 1\nDATA binary\n";
  const point = new Uint8Array(new Float32Array([1, 2, 3, 0]).buffer);
  await serve(files({ [`${AT}/point-cloud.pcd`]: Buffer.concat([Buffer.from(pcd), point]) }));
  const { overview, octree } = await Octree.open(AT);
  expect(octree).toBeNull();
  expect([...overview.xyz]).toEqual([1, 2, 3]);
  await serve((_, response) => response.writeHead(403).end());
  await expect(Octree.open(AT)).rejects.toMatchObject({ status: 403 });
});
