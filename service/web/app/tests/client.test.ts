import { expect, test } from "vitest";
import { all, get, onceKey, patch, post, Refused, remove } from "../src/api/client";
import { bytesText, named } from "../src/i18n";
import { serve } from "./serving";

test("a list is followed to its end, or as far as is wanted", async () => {
  const asked = await serve(({ path }, response) => {
    const cursor = new URL(path, "http://x").searchParams.get("cursor");
    const page = cursor ? { items: [3, 4], next_cursor: null } : { items: [1, 2], next_cursor: "a&b" };
    response.end(JSON.stringify(page));
  });
  expect(await all<number>("/v1/jobs?state=failed")).toEqual([1, 2, 3, 4]);
  expect(asked.map(({ path }) => path)).toEqual([
    "/v1/jobs?state=failed&limit=200",
    "/v1/jobs?state=failed&limit=200&cursor=a%26b",
  ]);
  expect(await all<number>("/v1/jobs", 2)).toEqual([1, 2]);
  expect(asked).toHaveLength(3);
});

test("every request says that it is of the page, each wish has a name of its own", async () => {
  const asked = await serve((_, response) => response.end("{}"));
  await post("/a", { x: 1 });
  await post("/a");
  await patch("/b", { y: 2 });
  expect(asked.map(({ headers }) => headers["x-groundplan-session"])).toEqual(["1", "1", "1"]);
  expect(asked.map(({ body }) => body.toString())).toEqual(['{"x":1}', "", '{"y":2}']);
  expect(asked[1]!.headers["content-type"]).toBeUndefined();
  const [first, second, third] = asked.map(({ headers }) => headers["idempotency-key"]);
  expect(first).toMatch(/^[0-9a-f]{32}$/);
  expect(second).not.toBe(first);
  expect(third).toBeUndefined();
  expect(new Set(Array.from({ length: 100 }, onceKey)).size).toBe(100);
});

test("a refusal has the service's own words, another answer its status", async () => {
  const problem = { type: "http://x/problems/gates-closed", title: "Gates", detail: "No.", gates: ["a"] };
  await serve(({ path }, response) => {
    response.writeHead(path === "/told" ? 409 : 502);
    response.end(path === "/told" ? JSON.stringify(problem) : "<html>");
  });
  const told = await get("/told").catch((cause: unknown) => cause);
  expect(told).toBeInstanceOf(Refused);
  expect(told).toMatchObject({ status: 409, title: "Gates", detail: "No.", type: problem.type, members: problem });
  await expect(get("/proxy")).rejects.toMatchObject({ status: 502, title: "Bad Gateway", type: "about:blank" });
});

test("what was removed answers with nothing", async () => {
  await serve((_, response) => response.writeHead(204).end());
  await expect(remove("/v1/keys/k")).resolves.toBeUndefined();
});

test("a value that this page has no words for names itself", () => {
  expect(named("kind", "read-scan")).toBe("Read a scan");
  expect(named("kind", "dance" as "read-scan")).toBe("dance");
});

test.each([
  [0, "0"],
  [999, "999"],
  [1500, "2"],
  [12_345_678, "12"],
  [3_210_000_000, "3.2"],
  [4.2e15, "4,200"],
])("%i bytes are shown as %s of a unit that people read", (bytes, number) => {
  expect(bytesText(bytes).split(" ")[0]).toBe(number);
});
