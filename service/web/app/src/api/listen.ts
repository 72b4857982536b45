const AGAIN_MS = 2000;

/** Whether the browser has given a stream up. */
export const isGivenUp = (source: EventSource): boolean => source.readyState === EventSource.CLOSED;

/**
 * Listen to a stream of events until what comes back is called; `begin` is given each connection.
 * The browser asks again after a lost connection, but gives up what is answered by anything else than a stream, as a
 * front's 502 while the service starts: that is asked for again here.
 */
export function listen(path: string, begin: (source: EventSource) => void): () => void {
  let source: EventSource;
  let again: ReturnType<typeof setTimeout> | undefined;
  const connect = () => {
    source = new EventSource(path);
    begin(source);
    source.addEventListener("error", () => {
      if (isGivenUp(source)) again = setTimeout(connect, AGAIN_MS);
    });
  };
  connect();
  return () => {
    source.close();
    clearTimeout(again);
  };
}
