import { useEffect, useRef, useState } from "preact/hooks";

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
