import { expect, test } from "vitest";
import { loadCloud, matrixOf, moved, poseOf } from "../src/view/cloud";
import { serve } from "./serving";

function pcdOf(points: number): Buffer {
  const head = `VERSION .7\nFIELDS x y z label\nSIZE 4 4 4 4\nPOINTS ${points}\nDATA binary\n`;
  const body = new Float32Array(points * 4).map((_, k) => (k % 4 === 3 ? 0 : Math.floor(k / 4) + (k % 4) / 10));
  return Buffer.concat([Buffer.from(head), Buffer.from(body.buffer)]);
}

/** Give a file in pieces that cut points and the header in two. */
const inPieces = (content: Buffer, size: number) =>
  serve((_, response) => {
    for (let at = 0; at < content.length; at += size) response.write(content.subarray(at, at + size));
    response.end();
  });

test.each([7, 100, 4096])("a cloud is the same in pieces of %i bytes", async (size) => {
  await inPieces(pcdOf(300), size);
  const cloud = await loadCloud("/c");
  expect(cloud.xyz).toHaveLength(900);
  expect(cloud.xyz[3 * 299]).toBe(299);
  expect(cloud.low[0]).toBe(0);
  expect(cloud.high[2]).toBeCloseTo(299.2, 4);
  expect(cloud.centre[0]).toBe(149.5);
});

test("of too many points every n-th is kept", async () => {
  await inPieces(pcdOf(1000), 333);
  const { xyz } = await loadCloud("/c", 100);
  expect([...xyz].filter((_, k) => k % 3 === 0)).toEqual(Array.from({ length: 100 }, (_, k) => 10 * k));
});

test("a file that ends too early or is none says so", async () => {
  await inPieces(pcdOf(300).subarray(0, 3000), 1000);
  await expect(loadCloud("/c")).rejects.toThrow("ended too early");
  await inPieces(Buffer.from("DATA ascii\n".repeat(300)), 1000);
  await expect(loadCloud("/c")).rejects.toThrow("encoding");
});

test("a pose and its matrix are each other's inverse", () => {
  const pose = { x: 1, y: -2, z: 0.5, yaw: 2.5 };
  expect(poseOf(matrixOf(pose))).toEqual(pose);
});

test("a scan is turned about its own middle: that stays where it is", () => {
  const T = matrixOf({ x: 3, y: 4, z: 0.1, yaw: 0.7 });
  const pivot = [2, -1, 0.5] as const;
  const at = (M: number[][]) =>
    [0, 1, 2].map((r) => M[r]!.slice(0, 3).reduce((s, v, k) => s + v * pivot[k]!, M[r]![3]!));
  const turned = moved(T, { x: 0, y: 0, yaw: 0.4 }, pivot);
  at(T).forEach((value, k) => expect(at(turned)[k]).toBeCloseTo(value, 12));
  expect(poseOf(turned).yaw).toBeCloseTo(1.1, 12);
  const shifted = at(moved(T, { x: 1, y: -2, yaw: 0.4 }, pivot));
  expect(shifted[0]! - at(T)[0]!).toBeCloseTo(1, 12);
  expect(shifted[1]! - at(T)[1]!).toBeCloseTo(-2, 12);
});
