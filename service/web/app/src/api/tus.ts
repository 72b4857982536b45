/** An upload in pieces that survives a lost connection and a closed page. */
import { onceKey, Refused, send } from "./client";
import { forget, keep, latest, type Parcel } from "./parcels";

const PIECE_BYTES = 2 * 1024 * 1024;
const PIECE_TIME_MS = 90_000;
const PAUSE_MS = 1500;
const TRIES = 5;
const TUS = { "Tus-Resumable": "1.0.0" };

export interface Watch {
  began: () => void;
  sent: (bytes: number) => void;
  waiting: (isWaiting: boolean) => void;
}

const encoded = (text: string): string => btoa(String.fromCharCode(...new TextEncoder().encode(text)));

async function begin(parcel: Parcel, signal: AbortSignal): Promise<Parcel> {
  const options = parcel.rough ? JSON.stringify({ rough_pose: parcel.rough }) : "{}";
  const said = { map_id: parcel.mapId, kind: "scan", filename: parcel.name, options };
  const metadata = Object.entries(said)
    .map(([name, text]) => `${name} ${encoded(text)}`)
    .join(",");
  const headers = {
    ...TUS,
    "Upload-Length": String(parcel.size),
    "Upload-Metadata": metadata,
    "Idempotency-Key": parcel.once,
  };
  const answer = await send("POST", "/v1/tus", { headers, signal });
  const location = new URL(answer.headers.get("Location")!, globalThis.location.href).pathname;
  signal.throwIfAborted();
  const begun = { ...parcel, location };
  await keep(begun);
  return begun;
}

async function sendPieces(parcel: Parcel, watch: Watch, signal: AbortSignal): Promise<string> {
  const place = parcel.location!;
  let answer = await send("HEAD", place, { headers: TUS, signal });
  for (;;) {
    const offset = Number(answer.headers.get("Upload-Offset"));
    const result = answer.headers.get("Groundplan-Result");
    watch.sent(offset);
    watch.waiting(false);
    if (result) return result.split("/").pop()!;
    const body = parcel.file!.slice(offset, offset + PIECE_BYTES);
    const headers = { ...TUS, "Upload-Offset": String(offset), "Content-Type": "application/offset+octet-stream" };
    // A tablet out of reach may never be told that its connection is gone; what came of the piece counts.
    answer = await send("PATCH", place, {
      headers,
      body,
      signal: AbortSignal.any([signal, AbortSignal.timeout(PIECE_TIME_MS)]),
    });
  }
}

const isGone = (cause: unknown) => cause instanceof Refused && [404, 410].includes(cause.status);
const isPassing = (cause: unknown) =>
  !(cause instanceof Refused) || [408, 409, 423].includes(cause.status) || cause.status >= 500;

async function deliverNow(parcel: Parcel, watch: Watch, signal: AbortSignal): Promise<string> {
  let now = parcel;
  watch.began();
  for (;;) {
    signal.throwIfAborted();
    try {
      if (!now.location) now = await begin(now, signal);
      return await sendPieces(now, watch, signal);
    } catch (cause) {
      signal.throwIfAborted();
      if (isGone(cause) && now.location) {
        now = { ...now, location: null, once: onceKey() };
        await keep(now);
      } else if (!isPassing(cause)) throw cause;
      watch.waiting(true);
      await new Promise((resolve) => setTimeout(resolve, PAUSE_MS));
    }
  }
}

let before: Promise<unknown> = Promise.resolve();

/**
 * Send all that the service has not yet, for as long as it takes or until `signal`; return the id of the scan.
 * Parcels go one after the other, in the order of the calls: a first scan shall not wait for a fifth.
 */
export function deliver(parcel: Parcel, watch: Watch, signal: AbortSignal): Promise<string> {
  const sent = before.then(() => deliverNow(parcel, watch, signal));
  before = sent.catch(() => null);
  return sent;
}

/** Forget a parcel, and what the service has of it so far; a scan that it has become stays. */
export async function giveUp(parcel: Parcel): Promise<void> {
  const location = (await latest(parcel))?.location ?? parcel.location;
  await forget(parcel);
  if (location) void removeUpload(location);
}

async function removeUpload(location: string): Promise<void> {
  for (let left = TRIES; left > 0; left--) {
    try {
      await send("DELETE", location, { headers: TUS });
      return;
    } catch (cause) {
      if (!isPassing(cause)) return; // it is gone, or will be when its time is over
      await new Promise((resolve) => setTimeout(resolve, PAUSE_MS));
    }
  }
}
