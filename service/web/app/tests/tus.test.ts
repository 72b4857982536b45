import { expect, test } from "vitest";
import type { ServerResponse } from "node:http";
import type { Parcel } from "../src/api/parcels";
import { deliver, type Watch } from "../src/api/tus";
import { serve, type Asked } from "./serving";

const PIECE = 2 * 1024 * 1024;

/** One that found no room in IndexedDB: it lives in the open page alone. */
const parcelOf = (bytes: Uint8Array<ArrayBuffer>, change: Partial<Parcel> = {}): Parcel => ({
  mapId: "map_1",
  name: "スキャン.ply",
  size: bytes.length,
  file: new Blob([bytes]),
  rough: null,
  once: "once-1",
  made: 1,
  location: null,
  scanId: null,
  isKept: false,
  ...change,
});

const bytesOf = (length: number) => new Uint8Array(length).map((_, k) => k % 251);

function watching() {
  const seen = { began: 0, sent: [] as number[], waiting: [] as boolean[] };
  const watch: Watch = {
    began: () => (seen.began += 1),
    sent: (bytes) => seen.sent.push(bytes),
    waiting: (is) => seen.waiting.push(is),
  };
  return { seen, watch };
}

/** Take an upload in pieces as the service does; `fault` may answer in its place. */
async function service(fault: (asked: Asked, response: ServerResponse) => boolean = () => false) {
  const uploads = new Map<string, { length: number; got: Buffer }>();
  const asked = await serve((request, response) => {
    if (fault(request, response)) return;
    const { method, path, headers, body } = request;
    if (method === "POST") {
      const place = `/v1/tus/${uploads.size + 1}`;
      uploads.set(place, { length: Number(headers["upload-length"]), got: Buffer.alloc(0) });
      response.writeHead(201, { Location: place }).end();
      return;
    }
    const upload = uploads.get(path);
    if (!upload) return void response.writeHead(404).end();
    if (method === "PATCH") {
      if (Number(headers["upload-offset"]) !== upload.got.length) return void response.writeHead(409).end();
      upload.got = Buffer.concat([upload.got, body]);
    }
    const done = upload.got.length === upload.length;
    const told = {
      "Upload-Offset": String(upload.got.length),
      ...(done && { "Groundplan-Result": "/v1/scans/scn_9" }),
    };
    response.writeHead(method === "HEAD" ? 200 : 204, told).end();
  });
  return { asked, uploads };
}

function metadataOf({ headers }: Asked): Map<string, string> {
  const pairs = String(headers["upload-metadata"]).split(",");
  return new Map(
    pairs.map((pair) => {
      const [name, text] = pair.split(" ") as [string, string];
      return [name, Buffer.from(text, "base64").toString("utf8")];
    }),
  );
}

test("a scan arrives whole in pieces, with its name, its map and where it was taken", async () => {
  const bytes = bytesOf(2 * PIECE + 5);
  const { asked, uploads } = await service();
  const { seen, watch } = watching();
  const rough = { x_m: 1, y_m: 2, yaw_rad: 0.5 };
  expect(await deliver(parcelOf(bytes, { rough }), watch, new AbortController().signal)).toBe("scn_9");
  expect(uploads.get("/v1/tus/1")!.got.equals(Buffer.from(bytes))).toBe(true);
  expect(seen).toEqual({ began: 1, sent: [0, PIECE, 2 * PIECE, bytes.length], waiting: [false, false, false, false] });
  expect(asked[0]!.headers["idempotency-key"]).toBe("once-1");
  expect(Object.fromEntries(metadataOf(asked[0]!))).toEqual({
    map_id: "map_1",
    kind: "scan",
    filename: "スキャン.ply",
    options: JSON.stringify({ rough_pose: rough }),
  });
});

test("an upload that was begun goes on where the service has it", async () => {
  const bytes = bytesOf(PIECE + 7);
  const { asked, uploads } = await service();
  uploads.set("/v1/tus/77", { length: bytes.length, got: Buffer.from(bytes.subarray(0, PIECE)) });
  const parcel = parcelOf(bytes, { location: "/v1/tus/77" });
  expect(await deliver(parcel, watching().watch, new AbortController().signal)).toBe("scn_9");
  expect(asked.map(({ method, body }) => [method, body.length])).toEqual([
    ["HEAD", 0],
    ["PATCH", 7],
  ]);
});

test("what passes is waited for, an upload that is gone is begun anew under another name", async () => {
  let [locked, lost] = [true, true];
  const { asked, uploads } = await service(({ method }, response) => {
    if (method === "HEAD" && locked) {
      locked = false;
      response.writeHead(423).end();
      return true;
    }
    if (method === "PATCH" && lost) {
      lost = false;
      uploads.clear();
      response.destroy();
      return true;
    }
    return false;
  });
  const { seen, watch } = watching();
  const bytes = bytesOf(9);
  expect(await deliver(parcelOf(bytes), watch, new AbortController().signal)).toBe("scn_9");
  expect(seen.waiting.filter(Boolean)).toHaveLength(3); // locked, cut off, gone
  const names = asked.filter(({ method }) => method === "POST").map(({ headers }) => headers["idempotency-key"]);
  expect(names).toHaveLength(2);
  expect(new Set(names).size).toBe(2);
});

test("a refusal ends it, and the next in line goes on", async () => {
  const { uploads } = await service(({ method, headers }, response) => {
    const refused = method === "POST" && headers["idempotency-key"] === "bad";
    if (refused) response.writeHead(415).end(JSON.stringify({ title: "No", detail: "no scan", type: "x" }));
    return refused;
  });
  const { signal } = new AbortController();
  const first = deliver(parcelOf(bytesOf(4), { once: "bad" }), watching().watch, signal);
  const second = deliver(parcelOf(bytesOf(3)), watching().watch, signal);
  await expect(first).rejects.toMatchObject({ status: 415, detail: "no scan" });
  expect(await second).toBe("scn_9");
  expect([...uploads.values()].map(({ length }) => length)).toEqual([3]);
});

test("parcels go one after the other, in the order of the calls", async () => {
  const { asked } = await service();
  const { signal } = new AbortController();
  const all = ["a", "b", "c"].map((once) => deliver(parcelOf(bytesOf(6), { once }), watching().watch, signal));
  await Promise.all(all);
  expect(asked.map(({ method }) => method)).toEqual(["a", "b", "c"].flatMap(() => ["POST", "HEAD", "PATCH"]));
  expect(asked.filter(({ method }) => method === "POST").map(({ headers }) => headers["idempotency-key"])).toEqual([
    "a",
    "b",
    "c",
  ]);
});

test("a parcel that was given up is sent no further", async () => {
  const { asked } = await service();
  const stop = new AbortController();
  stop.abort();
  await expect(deliver(parcelOf(bytesOf(6)), watching().watch, stop.signal)).rejects.toThrow();
  expect(asked).toEqual([]);
});
