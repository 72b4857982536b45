import { expect, test } from "vitest";
import { matrixOf } from "../src/view/cloud";
import { cornersOf, extentOf, type Extent } from "../src/view/GridPlan";
import { loadGrid } from "../src/view/grid";
import { cornersOf as cornersOfEllipse, ELLIPSE_TIMES, ellipseOf } from "../src/view/outlines";
import { Faces, residualColours, RESIDUALS } from "../src/view/residuals";
import { wallsOf } from "../src/view/TapPlan";
import { files, serve } from "./serving";
import { told } from "./told";

const AT = "/v1/maps/m/revisions/2/artifacts/occupancy-grid";

/** Node has no pictures: what the browser's own holds. */
class Picture {
  constructor(
    readonly data: Uint8ClampedArray,
    readonly width: number,
    readonly height: number,
  ) {}
}
Object.assign(globalThis, { ImageData: Picture });

test("a grid's cells are a picture in its place in the map", async () => {
  const pgm = Buffer.concat([Buffer.from("P5\n3 2\n255\n"), Buffer.from([0, 254, 205, 99, 100, 254])]);
  const yaml = "image: occupancy-grid.pgm\nresolution: 0.5\norigin: [-1.5, 2.25, 0]\n";
  await serve(files({ [`${AT}.pgm`]: pgm, [`${AT}.yaml`]: yaml }));
  const { picture, resolution, low, high } = await loadGrid("m", 2);
  expect({ resolution, low, high }).toEqual({ resolution: 0.5, low: [-1.5, 2.25], high: [0, 3.25] });
  const opaque = [...picture.data].filter((_, k) => k % 4 === 3).map((alpha) => alpha === 255);
  expect(opaque).toEqual([true, false, false, true, false, false]);
});

test("a grid that is no PGM is refused", async () => {
  await serve(files({ [`${AT}.pgm`]: "P2 3 2 255", [`${AT}.yaml`]: "resolution: 1\norigin: [0, 0, 0]" }));
  await expect(loadGrid("m", 2)).rejects.toThrow("no binary PGM");
});

test("grids are compared over the place that holds both", () => {
  const grids: Extent[] = [
    { low: [0, 0], high: [4, 2] },
    { low: [-1, 1], high: [3, 5] },
  ];
  expect(extentOf(grids)).toEqual({ low: [-1, 0], high: [4, 5] });
  expect(
    cornersOf([
      [1, 2],
      [3, -4],
    ]),
  ).toBe("1,-2 3,4");
});

test("the walls that the service writes have faces, and distance is to the nearest of them", () => {
  const faces = new Faces(told.walls[0]!);
  expect(faces.distance(2, 0.1)).toBeCloseTo(0, 4);
  expect(faces.distance(2, 0.13)).toBeCloseTo(0.03, 4);
  expect(faces.distance(2, -0.19)).toBeCloseTo(0.09, 4);
  expect(faces.distance(2, -0.21)).toBe(Infinity);
  expect(faces.distance(1.02, 1.2)).toBeCloseTo(0.02, 4); // of the column, whose ring is its geometry
});

test("points are coloured by their distance where the scan lies; off the walls and at the floor orange", () => {
  const faces = new Faces(told.walls[0]!);
  const local = [0.11, 0.14, 0.18, 0.25].flatMap((y) => [2, y, 1]).concat([2, 0.1, 0.05]);
  const xyz = new Float32Array(local.map((value, k) => value - [10, 0, 0][k % 3]!));
  const cloud = { xyz, centre: [0, 0, 0], low: [0, 0, 0], high: [0, 0, 0] } as Parameters<typeof residualColours>[1];
  const colours = residualColours(faces, cloud, matrixOf({ x: 10, y: 0, z: 0, yaw: 0 }), 0);
  const hex = Array.from(
    { length: 5 },
    (_, k) => `#${Buffer.from(colours.subarray(3 * k, 3 * k + 3)).toString("hex")}`,
  );
  expect(hex).toEqual([...RESIDUALS.map(({ colour }) => colour), "#ff6a13", "#ff6a13"]);
});

test("an ellipse has the axes of its covariance, and none where nothing determines it", () => {
  const [far, near, angle] = [0.04, 0.01, 0.6];
  const [c, s] = [Math.cos(angle), Math.sin(angle)];
  const xy = c * s * (far ** 2 - near ** 2);
  const covariance = [
    [(c * far) ** 2 + (s * near) ** 2, xy],
    [xy, (s * far) ** 2 + (c * near) ** 2],
  ];
  const ellipse = ellipseOf({ covariance })!;
  const times = Math.sqrt(5.991);
  expect(ellipse.half[0]).toBeCloseTo(times * far, 9);
  expect(ellipse.half[1]).toBeCloseTo(times * near, 9);
  expect(ellipse.angle).toBeCloseTo(angle, 9);
  const reach = cornersOfEllipse(ellipse, [5, 6]).map(([x, y]) => Math.hypot(x - 5, y - 6));
  expect(Math.max(...reach)).toBeCloseTo(ELLIPSE_TIMES * times * far, 6);
  expect(Math.min(...reach)).toBeCloseTo(ELLIPSE_TIMES * times * near, 6);
  expect(ellipseOf({ covariance: [Array<null>(6).fill(null), Array<null>(6).fill(null)] })).toBeNull();
  expect(ellipseOf({ covariance: null })).toBeNull();
});

test("the plan for taps holds every ring of the walls", () => {
  const { rings, low, high } = wallsOf(told.walls[0]!);
  expect(rings).toHaveLength(2);
  expect([low, high]).toEqual([
    [0, 0],
    [4, 3],
  ]);
});
