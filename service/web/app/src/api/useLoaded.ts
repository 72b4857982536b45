/** What a page shows, fetched anew whenever something happened. */
import { useCallback, useEffect, useRef, useState } from "preact/hooks";

export interface Loaded<T> {
  value: T | null;
  error: unknown;
  reload: () => void;
}

/** Load once, again when `again` changes, and every `everyMs` while the page is in sight and no load is under way. */
export function useLoaded<T>(load: () => Promise<T>, again: readonly unknown[] = [], everyMs?: number): Loaded<T> {
  const [state, setState] = useState<{ value: T | null; error: unknown }>({ value: null, error: null });
  const [round, setRound] = useState(0);
  const reload = useCallback(() => setRound((n) => n + 1), []);
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
    // eslint-disable-next-line react-hooks/exhaustive-deps -- the caller says what `load` depends on
  }, [...again, round]);
  useEffect(() => {
    if (everyMs === undefined) return;
    const timer = setInterval(
      () => document.visibilityState === "visible" && underWay.current === 0 && reload(),
      everyMs,
    );
    return () => clearInterval(timer);
  }, [everyMs, reload]);
  return { ...state, reload };
}
