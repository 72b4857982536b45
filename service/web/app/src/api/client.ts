/** The one way to the service: the public API, with the session cookie and its header. */
import { isGivenUp, listen } from "./listen";
import type { components } from "./schema"; // which `tools/build-dashboard` makes of the API's description

export type Schemas = components["schemas"];

type NamedKeys<V> = keyof { [K in keyof V as string extends K ? never : number extends K ? never : K]: V[K] };
/** Whether the API's description says of a member no more than that it is JSON. */
type IsOpen<V> = unknown extends V
  ? true
  : NonNullable<V> extends readonly (infer E)[]
    ? IsOpen<E>
    : NonNullable<V> extends object
      ? [NamedKeys<NonNullable<V>>] extends [never]
        ? IsOpen<NonNullable<V>[keyof NonNullable<V>]>
        : false
      : false;
/** A schema with members told here in full; what else it leaves open no page can read. */
type Told<T, M = unknown> = { [K in keyof T as IsOpen<T[K]> extends false ? K : never]: T[K] } & M;

export type Job = Told<Schemas["JobOut"]>;
export type SiteMap = Told<Schemas["MapOut"]>;
export type Placement = Told<Schemas["PlacementOut"]>;
export type Scan = Told<Schemas["ScanOut"]>;
export type Drawing = Told<Schemas["DrawingOut"]>;
export type Reading = NonNullable<Drawing["reading"]>;
export type Scale = NonNullable<Reading["scale"]>;
/** Metres a unit, or the lowest and highest that are likely. */
export type Likely = NonNullable<NonNullable<Scale["witnesses"]>[number]["metres_per_unit"]>;
export type Revision = Told<Schemas["RevisionOut"]>;
export type Robot = Told<Schemas["RobotOut"]>;
export type Key = Told<Schemas["KeyOut"]>;
export type Evidence = NonNullable<Placement["evidence"]>;
export type Session = Schemas["SessionOut"];
export type Stats = Told<Schemas["StatsOut"]>;
export type AuditEntry = Told<Schemas["AuditEntryOut"], { before: unknown; after: unknown }>;
export type Publication = Told<Schemas["PublicationOut"]>;
export type Layer = Told<Schemas["LayerOut"]>;
export type Proposal = Told<Schemas["ProposalOut"]>;
export type Rollout = Told<Schemas["RolloutOut"]>;
export type Convergence = Schemas["ConvergenceOut"];
export type Counted = Schemas["CountedRobotsOut"];
export type Compared = Told<Schemas["ComparedOut"]>;
export type Operation = NonNullable<Schemas["RevisionIn"]["operations"]>[number];

export interface Page<T> {
  items: T[];
  next_cursor: string | null;
}

/** A refusal of the service, in its own words. */
export class Refused extends Error {
  constructor(
    readonly status: number,
    readonly title: string,
    readonly detail: string,
    readonly type: string,
    readonly members: Record<string, unknown> = {},
  ) {
    super(detail);
  }
}

const OWN_PAGE = { "X-Groundplan-Session": "1" };

async function refusalOf(answer: Response): Promise<Refused> {
  try {
    const problem = (await answer.json()) as Record<string, unknown>;
    return new Refused(answer.status, String(problem.title), String(problem.detail), String(problem.type), problem);
  } catch {
    return new Refused(answer.status, answer.statusText || "HTTP", String(answer.status), "about:blank");
  }
}

export async function send(method: string, path: string, init: RequestInit = {}): Promise<Response> {
  const headers = { ...OWN_PAGE, ...(init.headers as Record<string, string> | undefined) };
  const answer = await fetch(path, { ...init, method, headers, credentials: "same-origin" });
  if (!answer.ok) throw await refusalOf(answer);
  return answer;
}

async function ask<T>(method: string, path: string, body?: unknown, headers: Record<string, string> = {}): Promise<T> {
  const init: RequestInit =
    body === undefined
      ? { headers }
      : { headers: { "Content-Type": "application/json", ...headers }, body: JSON.stringify(body) };
  const answer = await send(method, path, init);
  return (answer.status === 204 ? undefined : await answer.json()) as T;
}

/** A name for one wish of the user: sent again, it has no second effect. */
export function onceKey(): string {
  return Array.from(crypto.getRandomValues(new Uint8Array(16)), (b) => b.toString(16).padStart(2, "0")).join("");
}

const getJson = <T>(path: string): Promise<T> => ask<T>("GET", path);
/** Read JSON; `get.bytes` and `get.text` read files. */
export const get = Object.assign(getJson, {
  bytes: async (path: string): Promise<ArrayBuffer> => (await send("GET", path)).arrayBuffer(),
  text: async (path: string): Promise<string> => (await send("GET", path)).text(),
});
export const put = <T>(path: string, body: unknown): Promise<T> => ask<T>("PUT", path, body);
export const patch = <T>(path: string, body: unknown): Promise<T> => ask<T>("PATCH", path, body);
export const remove = (path: string): Promise<void> => ask("DELETE", path);
export const post = <T>(path: string, body?: unknown, headers: Record<string, string> = {}): Promise<T> =>
  ask<T>("POST", path, body, { "Idempotency-Key": onceKey(), ...headers });

/** Follow a list to its end, `most` items at most. */
export async function all<T>(path: string, most = 2000): Promise<T[]> {
  const items: T[] = [];
  let cursor: string | null = null;
  do {
    const joint = path.includes("?") ? "&" : "?";
    const page: Page<T> = await get(`${path}${joint}limit=200${cursor ? `&cursor=${encodeURIComponent(cursor)}` : ""}`);
    items.push(...page.items);
    cursor = page.next_cursor;
  } while (cursor && items.length < most);
  return items;
}

/** Wait until a job has ended; `watch` hears of every change. Fails where the service says that it tells no more. */
export function follow(job: Job, watch?: (job: Job) => void): Promise<Job> {
  if (isFinal(job)) return Promise.resolve(job);
  return new Promise((resolve, reject) => {
    const hear = (now: Job) => {
      watch?.(now);
      if (!isFinal(now)) return;
      stop();
      resolve(now);
    };
    const refused = (cause: unknown) => {
      const isTheService = cause instanceof Refused && cause.type !== "about:blank"; // and no front for it
      if (!isTheService || cause.status >= 500 || cause.status === 429) return;
      stop();
      reject(cause);
    };
    const stop = listen(`/v1/jobs/${job.id}/events`, (source) => {
      source.addEventListener("job", (event) => hear(JSON.parse((event as MessageEvent<string>).data) as Job));
      source.addEventListener("error", () => {
        if (isGivenUp(source)) get<Job>(`/v1/jobs/${job.id}`).then(hear, refused);
      });
    });
  });
}

export const isFinal = (job: Job): boolean => !["queued", "running"].includes(job.state);
