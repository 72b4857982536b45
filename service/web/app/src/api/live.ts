/** What a page shows, fetched anew whenever something happened. */
import { useEffect, useRef, useState } from "preact/hooks";

export interface Loaded<T> {
  value: T | null;
  error: unknown;
  reload: () => void;
}

/** Load once, again when `again` changes, and every `everyMs` while the page is in sight and no load is under way. */
export function useLoaded<T>(load: () => Promise<T>, again: readonly unknown[] = [], everyMs?: number): Loaded<T> {
  const [state, setState] = useState<{ value: T | null; error: unknown }>({ value: null, error: null });
  const [round, setRound] = useState(0);
  const reload = useRef(() => setRound((n) => n + 1)).current;
  const underWay = useRef(0);
  useEffect(() => {
    let wanted = true;
    underWay.current += 1;
    load()
      .then(
        (value) => wanted && setState({ value, error: null }),
        (error: unknown) => wanted && setState((old) => ({ value: old.value, error })),
      )
      .finally(() => {
        underWay.current -= 1;
      });
    return () => {
      wanted = false;
    };
  }, [...again, round]);
  useEffect(() => {
    if (everyMs === undefined) return;
    const timer = setInterval(
      () => document.visibilityState === "visible" && underWay.current === 0 && reload(),
      everyMs,
    );
    return () => clearInterval(timer);
  }, [everyMs]);
  return { ...state, reload };
}

/** Call `heard` when something happens in the fleet, and once more after every lost connection. */
export function useFleetEvents(heard: () => void): boolean {
  const [connected, setConnected] = useState(false);
  const latest = useRef(heard);
  latest.current = heard;
  useEffect(() => {
    let source: EventSource | null = null;
    let pending: ReturnType<typeof setTimeout> | undefined;
    let again: ReturnType<typeof setTimeout> | undefined;
    const soon = () => {
      pending ??= setTimeout(() => {
        pending = undefined;
        latest.current();
      }, 150);
    };
    const connect = () => {
      source = new EventSource("/v1/events");
      source.addEventListener("open", () => {
        setConnected(true);
        soon();
      });
      source.addEventListener("error", () => {
        setConnected(false);
        if (source?.readyState === EventSource.CLOSED) again = setTimeout(connect, 2000);
      });
      for (const kind of ["publication", "report"]) source.addEventListener(kind, soon);
    };
    connect();
    return () => {
      source?.close();
      clearTimeout(pending);
      clearTimeout(again);
    };
  }, []);
  return connected;
}
