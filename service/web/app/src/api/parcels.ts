/** The scans that are on their way, kept in IndexedDB until the service has placed them: a closed page loses none. */
import { onceKey } from "./client";

export interface Rough {
  x_m: number;
  y_m: number;
  yaw_rad: number;
}

/** A scan on its way. It is forgotten when it was taken into the map, or the user gives it up. */
export interface Parcel {
  mapId: string;
  name: string;
  size: number;
  file: Blob | null;
  rough: Rough | null;
  once: string;
  made: number;
  location: string | null;
  scanId: string | null;
  isKept: boolean;
}

const [DATABASE, VERSION, STORE] = ["groundplan-tablet", 2, "queue"];

function opened(): Promise<IDBDatabase> {
  return new Promise((resolve, reject) => {
    const request = indexedDB.open(DATABASE, VERSION);
    request.onupgradeneeded = () => request.result.createObjectStore(STORE, { keyPath: "made" });
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

/** All that is kept, the oldest first. */
export const kept = (): Promise<Parcel[]> => withStore("readonly", (store) => store.getAll() as IDBRequest<Parcel[]>);

/** A parcel as it was kept last. */
export const latest = (parcel: Parcel): Promise<Parcel | undefined> =>
  withStore("readonly", (store) => store.get(parcel.made) as IDBRequest<Parcel | undefined>);

/** Keep what has become of a parcel; one that found no room when it was made lives in the open page alone. */
export async function keep(parcel: Parcel): Promise<void> {
  if (parcel.isKept) await withStore("readwrite", (store) => store.put(parcel));
}

export const forget = (parcel: Parcel): Promise<unknown> =>
  withStore("readwrite", (store) => store.delete(parcel.made));

/** Make a parcel and keep it; `isKept` tells whether the tablet had room for it. */
export async function newParcel(mapId: string, file: File, rough: Rough | null): Promise<Parcel> {
  const parcel = {
    mapId,
    name: file.name,
    size: file.size,
    file,
    rough,
    once: onceKey(),
    made: Date.now(),
    location: null,
    scanId: null,
    isKept: true,
  };
  try {
    await keep(parcel);
    return parcel;
  } catch {
    return { ...parcel, isKept: false };
  }
}
