/** An upload in pieces that survives a lost connection and a closed page: what is sent is kept in IndexedDB. */
import { onceKey, Refused, send } from "./client";

export interface Rough {
  x_m: number;
  y_m: number;
  yaw_rad: number;
}

/** A scan on its way. It is forgotten when the service has placed it, or the user gives it up. */
export interface Parcel {
  mapId: string;
  name: string;
  size: number;
  file: Blob | null;
  rough: Rough | null;
  once: string;
  location: string | null;
  scanId: string | null;
}

const PIECE_BYTES = 2 * 1024 * 1024;
const PAUSE_MS = 1500;
const TUS = { "Tus-Resumable": "1.0.0" };
const [DATABASE, STORE, ONLY] = ["groundplan-tablet", "parcels", "parcel"];

function opened(): Promise<IDBDatabase> {
  return new Promise((resolve, reject) => {
    const request = indexedDB.open(DATABASE, 1);
    request.onupgradeneeded = () => request.result.createObjectStore(STORE);
    request.onsuccess = () => resolve(request.result);
    request.onerror = () => reject(request.error ?? new Error("IndexedDB"));
  });
}

async function withStore<T>(mode: IDBTransactionMode, act: (store: IDBObjectStore) => IDBRequest<T>): Promise<T> {
  const database = await opened();
  try {
    return await new Promise<T>((resolve, reject) => {
      const transaction = database.transaction(STORE, mode);
      const request = act(transaction.objectStore(STORE));
      transaction.oncomplete = () => resolve(request.result);
      transaction.onabort = () => reject(transaction.error ?? new Error("IndexedDB"));
    });
  } finally {
    database.close();
  }
}

export const kept = (): Promise<Parcel | undefined> => withStore("readonly", (store) => store.get(ONLY) as IDBRequest<Parcel | undefined>);
export const keep = (parcel: Parcel): Promise<unknown> => withStore("readwrite", (store) => store.put(parcel, ONLY));
export const forget = (): Promise<unknown> => withStore("readwrite", (store) => store.delete(ONLY));

export const newParcel = (mapId: string, file: File, rough: Rough | null): Parcel => ({
  mapId, name: file.name, size: file.size, file, rough, once: onceKey(), location: null, scanId: null,
});

export interface Watch {
  sent: (bytes: number) => void;
  waiting: (isWaiting: boolean) => void;
}

const encoded = (text: string): string => btoa(String.fromCharCode(...new TextEncoder().encode(text)));

async function begin(parcel: Parcel, signal: AbortSignal): Promise<Parcel> {
  const options = parcel.rough ? JSON.stringify({ rough_pose: parcel.rough }) : "{}";
  const said = { map_id: parcel.mapId, kind: "scan", filename: parcel.name, options };
  const metadata = Object.entries(said).map(([name, text]) => `${name} ${encoded(text)}`).join(",");
  const headers = { ...TUS, "Upload-Length": String(parcel.size), "Upload-Metadata": metadata, "Idempotency-Key": parcel.once };
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
    answer = await send("PATCH", place, { headers, body, signal });
  }
}

const isGone = (cause: unknown) => cause instanceof Refused && [404, 410].includes(cause.status);
const isPassing = (cause: unknown) => !(cause instanceof Refused) || [408, 409, 423].includes(cause.status) || cause.status >= 500;

/** Send all that the service has not yet, for as long as it takes or until `signal`; return the id of the scan. */
export async function deliver(parcel: Parcel, watch: Watch, signal: AbortSignal): Promise<string> {
  let now = parcel;
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
