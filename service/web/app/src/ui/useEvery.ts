import { useEffect, useState } from "preact/hooks";

/** A number that grows every so often while the page is in sight, and a way to let it grow at once. */
export function useEvery(ms: number): [number, () => void] {
  const [round, setRound] = useState(0);
  const again = () => setRound((n) => n + 1);
  useEffect(() => {
    const timer = setInterval(() => document.visibilityState === "visible" && again(), ms);
    return () => clearInterval(timer);
  }, [ms]);
  return [round, again];
}
