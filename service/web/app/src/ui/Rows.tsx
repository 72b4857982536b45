/** A table of any length: only the rows in sight are in the page, and pages are fetched as they come near. */
import type { ComponentChildren } from "preact";
import { useEffect, useRef, useState } from "preact/hooks";
import { get, type Page } from "../api/client";
import { t } from "../i18n";
import { Failure, Loading } from "./parts";

const ROW_PX = 56;
const AROUND = 8;
const REFRESHED_ROWS = 600;

export interface Column<T> {
  name: string;
  width: string;
  show: (row: T) => ComponentChildren;
}

interface RowsProps<T> {
  label: string;
  path: string;
  columns: Column<T>[];
  keyOf: (row: T) => string;
  refresh?: number;
  none?: string;
  keep?: (row: T) => boolean;
}

interface Fetched<T> {
  items: T[];
  cursor: string | null;
  done: boolean;
}

// eslint-disable-next-line @typescript-eslint/no-unnecessary-type-parameters -- of what type its rows are
function usePages<T>(path: string, refresh: number) {
  const [state, setState] = useState<Fetched<T>>({ items: [], cursor: null, done: false });
  const [error, setError] = useState<unknown>(null);
  const busy = useRef(false);
  const round = useRef(0);
  const shown = useRef("");
  const load = async (mine: number, from: Fetched<T>, most: number) => {
    if (busy.current && mine === round.current && from.cursor) return;
    busy.current = true;
    try {
      let now = from;
      do {
        const joint = path.includes("?") ? "&" : "?";
        const after = now.cursor ? `&cursor=${encodeURIComponent(now.cursor)}` : "";
        const page = await get<Page<T>>(`${path}${joint}limit=200${after}`);
        now = { items: [...now.items, ...page.items], cursor: page.next_cursor, done: page.next_cursor === null };
      } while (!now.done && now.items.length < most);
      if (mine === round.current) setState(now);
      setError(null);
    } catch (cause) {
      setError(cause);
    } finally {
      busy.current = false;
    }
  };
  useEffect(() => {
    const anew = shown.current !== path;
    if (!anew && state.items.length > REFRESHED_ROWS) return;
    shown.current = path;
    round.current += 1;
    void load(round.current, { items: [], cursor: null, done: false }, Math.max(1, state.items.length));
    // eslint-disable-next-line react-hooks/exhaustive-deps -- what was fetched shall not be fetched anew for it
  }, [path, refresh]);
  const more = () => {
    if (!state.done && state.cursor && !busy.current) void load(round.current, state, 0);
  };
  return { ...state, error, more, begun: state.done || state.items.length > 0 };
}

export function Rows<T>({ label, path, columns, keyOf, refresh = 0, none, keep }: RowsProps<T>) {
  const { items: fetched, done, error, more, begun } = usePages<T>(path, refresh);
  const items = keep ? fetched.filter(keep) : fetched;
  const box = useRef<HTMLDivElement>(null);
  const [span, setSpan] = useState({ from: 0, to: 40 });
  const look = () => {
    const { scrollTop, clientHeight } = box.current!;
    const from = Math.max(0, Math.floor(scrollTop / ROW_PX) - AROUND);
    setSpan({ from, to: Math.ceil((scrollTop + clientHeight) / ROW_PX) + AROUND });
  };
  useEffect(() => {
    if (begun && span.to > items.length - 40) more();
    // eslint-disable-next-line react-hooks/exhaustive-deps -- `more` is another at each drawing of the table
  }, [span.to, items.length, begun]);
  const grid = { gridTemplateColumns: columns.map((column) => column.width).join(" ") };
  if (!begun && !error) return <Loading />;
  return (
    <>
      <Failure error={error} />
      {done && items.length === 0 ? (
        <p class="none">{none ?? t("empty")}</p>
      ) : (
        <div
          class="rows"
          ref={box}
          onScroll={look}
          tabIndex={0}
          role="table"
          aria-label={label}
          aria-rowcount={done ? items.length + 1 : -1}
        >
          <div class="row head" role="row" aria-rowindex={1} style={grid}>
            {columns.map((column) => (
              <span key={column.name} role="columnheader">
                {column.name}
              </span>
            ))}
          </div>
          <div class="rows-body" role="rowgroup" style={{ height: `${items.length * ROW_PX}px` }}>
            {items.slice(span.from, span.to).map((row, k) => (
              <div
                key={keyOf(row)}
                class="row"
                role="row"
                aria-rowindex={span.from + k + 2}
                style={{ ...grid, transform: `translateY(${(span.from + k) * ROW_PX}px)` }}
              >
                {columns.map((column) => (
                  <span key={column.name} role="cell">
                    {column.show(row)}
                  </span>
                ))}
              </div>
            ))}
          </div>
        </div>
      )}
    </>
  );
}
