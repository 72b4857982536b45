import { useEffect, useRef, useState } from "preact/hooks";
import { listen } from "./listen";

/** Call `heard` when something happens in the fleet, and once more after every lost connection. */
export function useFleetEvents(heard: () => void): boolean {
  const [connected, setConnected] = useState(false);
  const latest = useRef(heard);
  latest.current = heard;
  useEffect(() => {
    let pending: ReturnType<typeof setTimeout> | undefined;
    const soon = () => {
      pending ??= setTimeout(() => {
        pending = undefined;
        latest.current();
      }, 150);
    };
    const stop = listen("/v1/events", (source) => {
      source.addEventListener("open", () => {
        setConnected(true);
        soon();
      });
      source.addEventListener("error", () => setConnected(false));
      for (const kind of ["publication", "report"]) source.addEventListener(kind, soon);
    });
    return () => {
      stop();
      clearTimeout(pending);
    };
  }, []);
  return connected;
}
