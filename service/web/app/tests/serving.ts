/** A real HTTP server for one test, which paths without a host reach as they do in a page. */
import { createServer, type IncomingMessage, type ServerResponse } from "node:http";
import type { AddressInfo } from "node:net";
import { onTestFinished } from "vitest";

export interface Asked {
  method: string;
  path: string;
  headers: IncomingMessage["headers"];
  body: Buffer;
}

type Answer = (asked: Asked, response: ServerResponse) => void;

export async function serve(answer: Answer): Promise<Asked[]> {
  const all: Asked[] = [];
  const server = createServer((request, response) => {
    const parts: Buffer[] = [];
    request.on("data", (part: Buffer) => parts.push(part));
    request.on("end", () => {
      const { method = "", url = "", headers } = request;
      const asked = { method, path: url, headers, body: Buffer.concat(parts) };
      all.push(asked);
      answer(asked, response);
    });
  });
  await new Promise<void>((resolve) => server.listen(0, "127.0.0.1", resolve));
  const base = `http://127.0.0.1:${(server.address() as AddressInfo).port}`;
  const { fetch } = globalThis;
  globalThis.fetch = (path, init) => fetch(new URL(path as string, base), init);
  Object.defineProperty(globalThis, "location", { value: { href: base }, configurable: true });
  onTestFinished(() => {
    globalThis.fetch = fetch;
    server.closeAllConnections();
    server.close();
  });
  return all;
}

/** Answer with files, with parts of them where a part is asked for; anything else is 404. */
export const files =
  (held: Record<string, string | Uint8Array>): Answer =>
  ({ path, headers }, response) => {
    const found = held[path];
    if (found === undefined) {
      response.writeHead(404, { "Content-Type": "application/problem+json" });
      response.end(JSON.stringify({ title: "Not found", detail: path, type: "about:blank" }));
      return;
    }
    const bytes = Buffer.from(found);
    const range = /^bytes=(\d+)-(\d+)$/.exec(headers.range ?? "");
    response.writeHead(range ? 206 : 200);
    response.end(range ? bytes.subarray(Number(range[1]), Number(range[2]) + 1) : bytes);
  };
