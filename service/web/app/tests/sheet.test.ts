import { expect, test } from "vitest";
import type { Drawing } from "../src/api/client";
import {
  isHidden,
  isKept,
  loadStrokes,
  mostlyInside,
  offBy,
  reasonOf,
  toDrawing,
  toFile,
  type Framed,
} from "../src/view/sheet";
import { files, serve } from "./serving";
import { told } from "./told";

async function strokes() {
  const [walls, removed] = told.strokes;
  await serve(files({ "/walls": JSON.stringify(walls), "/removed": JSON.stringify(removed) }));
  return loadStrokes({ files: { walls: "/walls", removed: "/removed" } } as unknown as Drawing);
}

test("what was set aside is drawn first, and each stroke is what the service says of it", async () => {
  const [text, wall, pier] = await strokes();
  expect(text).toMatchObject({ layer: "text", reason: "small", closed: false, low: [1, 1], high: [2, 2] });
  expect(wall).toMatchObject({ layer: "wall", closed: true });
  expect(wall!.lines[0]).toHaveLength(6); // both faces, one there and one back
  expect(wall!.low[1]).toBeCloseTo(-0.1, 4);
  expect(pier).toMatchObject({ layer: "column", closed: true, low: [1, 1], high: [1.4, 1.4] });
  expect([text, wall, pier].map((one) => isKept(one!))).toEqual([false, true, true]);
  expect(new Set([text, wall, pier].map((one) => one!.id)).size).toBe(3);
});

test("a stroke is hidden by its layer or by its reason", async () => {
  const [text, wall] = await strokes();
  expect(isHidden(text!, new Set(["text"]))).toBe(true);
  expect(isHidden(text!, new Set([reasonOf(text!)]))).toBe(true);
  expect(isHidden(wall!, new Set(["text"]))).toBe(false);
});

const inMetres = {
  scale: { state: "given", metres_per_unit: 0.01 },
  drawing_origin: [2, 3],
  drawing_top: null,
} as const;
const inPixels = { scale: null, drawing_origin: null, drawing_top: 400 };
const framed = (reading: object) => reading as Framed;

test.each([inMetres, inPixels].map(framed))(
  "places go to the file's own coordinates and back (y down: $drawing_top)",
  (reading) => {
    const back = toDrawing(reading, toFile(reading, [1.25, 3.5]));
    expect(back[0]).toBeCloseTo(1.25, 12);
    expect(back[1]).toBeCloseTo(3.5, 12);
  },
);

test("metres become the file's units, and y runs down where the file's does", () => {
  const reading = framed(inMetres);
  expect(toFile({ ...reading, drawing_top: null }, [1, 1])).toEqual([300, 400]);
  expect(toFile({ ...reading, drawing_top: 4 }, [1, 1])).toEqual([300, 300]);
});

test("a stroke is taken when more than half of it is drawn around", async () => {
  const [text] = await strokes(); // from (1, 1) to (2, 2)
  const upTo = (x: number) => [[0, 0], [x, 0], [x, 3], [0, 3]] as [number, number][]; // prettier-ignore
  expect(mostlyInside(text!, upTo(1.75))).toBe(true);
  expect(mostlyInside(text!, upTo(1.25))).toBe(false);
  expect(mostlyInside({ ...text!, lines: [] }, upTo(9))).toBe(false);
});

test("a witness that names a range differs only where the scale is outside of it", () => {
  expect(offBy(0.01, 0.0103)).toBeCloseTo(3, 9);
  expect(offBy(0.01, [0.008, 0.02])).toBe(0);
  expect(offBy(0.01, [0.02, 0.05])).toBeCloseTo(100, 9);
  expect(offBy(0.01, [0.001, 0.005])).toBeCloseTo(-50, 9);
});
