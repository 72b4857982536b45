/** Correct a drawing: what is a wall and what is not, how large it is, and the first map from it. */
import { useEffect, useLayoutEffect, useMemo, useRef, useState } from "preact/hooks";
import { follow, get, patch, type Drawing, type Job, type Reading, type Schemas } from "../api/client";
import type { Edit, Point, StrokeLayer } from "../api/told";
import { useLoaded } from "../api/useLoaded";
import { named, t } from "../i18n";
import { Failure, Loading, Progress } from "../ui/parts";
import { SheetTiles } from "../view/SheetTiles";
import { SheetView, type Mark } from "../view/SheetView";
import {
  isHidden,
  isKept,
  KEPT,
  loadStrokes,
  mostlyInside,
  sizeOf,
  toDrawing,
  toFile,
  type Stroke,
} from "../view/sheet";
import { BuildPanel } from "./BuildPanel";
import { StrokeLayers } from "./StrokeLayers";
import { ScalePanel, type KnownLength } from "./ScalePanel";

const TOOLS = ["pan", "keep", "drop", "addWall", "erase", "include", "exclude", "scale"] as const;
type Tool = (typeof TOOLS)[number];
const LASSOS: readonly Tool[] = ["keep", "drop", "erase", "include", "exclude"];
const SET_ASIDE = "other";
const COLOURS: Record<string, string> = {
  include: "#1c8048",
  exclude: "#cd2828",
  "erase-walls": "#cd2828",
  "add-wall": "#0b5cad",
  move: "#8a5000",
};

interface Open {
  drawing: Drawing;
  tiles: SheetTiles | null;
  reading: Reading | null;
  strokes: Stroke[];
}

async function open(drawingId: string): Promise<Open> {
  const drawing = await get<Drawing>(`/v1/drawings/${drawingId}`);
  const [strokes, tiles] = await Promise.all([loadStrokes(drawing), SheetTiles.open(drawing)]);
  return { drawing, tiles, reading: drawing.reading, strokes };
}

function marksOf(edits: readonly Edit[], reading: Reading): Mark[] {
  return edits.flatMap((edit) => {
    const shape = edit.action === "add-wall" ? edit.line : edit.within;
    return shape
      ? [
          {
            ring: shape.map((at) => toDrawing(reading, at)),
            closed: edit.action !== "add-wall",
            colour: COLOURS[edit.action]!,
          },
        ]
      : [];
  });
}

const wordsOf = (edit: Edit): string =>
  edit.action === "move" ? (edit.to === "wall" ? t("draw.keep") : t("draw.drop")) : named("edit", edit.action);

/** Corrections as a text that does not depend on the order of their members. */
const textOf = (edits: readonly Edit[]): string =>
  JSON.stringify(edits, ["action", "to", "strokes", "within", "of", "line", "thickness_m"]);

/** The corrections, each step of which can be taken back and done again. */
function useEdits(said: readonly Edit[]) {
  const [state, setState] = useState<{ done: readonly Edit[]; undone: readonly Edit[] }>({ done: said, undone: [] });
  const { done, undone } = state;
  return {
    edits: done,
    add: (edit: Edit) => setState({ done: [...done, edit], undone: [] }),
    undo: done.length > 0 ? () => setState({ done: done.slice(0, -1), undone: [done.at(-1)!, ...undone] }) : undefined,
    redo: undone.length > 0 ? () => setState({ done: [...done, undone[0]!], undone: undone.slice(1) }) : undefined,
  };
}

interface EditorProps extends Open {
  reading: Reading;
  mapId: string;
  reload: () => void;
}

const MOST_STROKES = 1000;

/** What a person drew around, as a correction: by layers, or stroke by stroke where some of a layer are hidden. */
function editFrom(tool: Tool, within: number[][], shown: StrokeLayer[], named: string[] | null): Edit {
  if (named && (tool === "keep" || tool === "drop"))
    return { action: "move", strokes: named, to: tool === "keep" ? "wall" : SET_ASIDE };
  if (tool === "keep")
    return { action: "move", within, of: shown.filter((layer) => !KEPT.includes(layer)), to: "wall" };
  if (tool === "drop")
    return { action: "move", within, of: shown.filter((layer) => KEPT.includes(layer)), to: SET_ASIDE };
  return { action: tool === "erase" ? "erase-walls" : (tool as "include" | "exclude"), within };
}

function Editor({ drawing, reading, strokes, tiles, mapId, reload }: EditorProps) {
  const canvas = useRef<HTMLCanvasElement>(null);
  const view = useRef<SheetView | null>(null);
  const said = drawing.options.edits ?? [];
  const { edits, add, undo, redo } = useEdits(said);
  const [tool, setTool] = useState<Tool>("pan");
  const [clicks, setClicks] = useState<Point[]>([]);
  const [hidden, setHidden] = useState<ReadonlySet<string>>(new Set());
  const [pixels, setPixels] = useState(true);
  const [job, setJob] = useState<Job | null>(null);
  const [error, setError] = useState<unknown>(null);
  const layers = useMemo(() => [...new Set(strokes.map((one) => one.layer))], [strokes]);
  const unsaved = textOf(edits) !== textOf(said);
  const lit = useMemo(() => {
    const fresh = edits.slice(said.length).flatMap((edit) => (edit.action === "move" && edit.within ? [edit] : []));
    const rings = fresh.map((edit) => ({
      of: edit.of ?? layers,
      ring: edit.within!.map((at) => toDrawing(reading, at)),
    }));
    const called = new Set(
      edits.slice(said.length).flatMap((edit) => (edit.action === "move" ? (edit.strokes ?? []) : [])),
    );
    return new Set(
      strokes
        .filter(
          (one) =>
            called.has(one.id) || rings.some(({ of, ring }) => of.includes(one.layer) && mostlyInside(one, ring)),
        )
        .map((one) => one.id),
    );
  }, [edits, strokes, layers, reading, said.length]);

  const heard = useRef<{ tapped: (at: Point) => void; drawn: (ring: Point[]) => void }>(null!);
  heard.current = {
    tapped: (at) => {
      if (tool !== "scale" && tool !== "addWall") return;
      const next = clicks.length > 1 ? [at] : [...clicks, at];
      if (tool === "addWall" && next.length === 2) {
        add({ action: "add-wall", line: next.map((one) => toFile(reading, one)) });
        setClicks([]);
      } else setClicks(next);
    },
    drawn: (ring) => {
      const inside = strokes
        .filter((one) => !isHidden(one, hidden) && isKept(one) === (tool === "drop") && mostlyInside(one, ring))
        .map((one) => one.id);
      const byName =
        [...hidden].some((name) => !layers.includes(name as StrokeLayer)) &&
        inside.length > 0 &&
        inside.length <= MOST_STROKES;
      add(
        editFrom(
          tool,
          ring.map((at) => toFile(reading, at)),
          layers.filter((layer) => !hidden.has(layer)),
          byName ? inside : null,
        ),
      );
    },
  };
  useLayoutEffect(() => {
    const made = new SheetView(canvas.current!, sizeOf(reading), {
      tapped: (at) => heard.current.tapped(at),
      drawn: (ring) => heard.current.drawn(ring),
    });
    view.current = made;
    return () => made.leave();
  }, [reading]);
  useLayoutEffect(() => view.current?.show(strokes, hidden, lit), [reading, strokes, hidden, lit]);
  useLayoutEffect(() => view.current?.under(pixels ? tiles : null), [reading, tiles, pixels]);
  useLayoutEffect(() => () => tiles?.leave(), [tiles]);
  useLayoutEffect(
    () =>
      view.current?.mark([
        ...marksOf(edits, reading),
        ...(clicks.length ? [{ ring: clicks, closed: false, colour: "#d4006a" }] : []),
      ]),
    [reading, edits, clicks],
  );
  const restart = () => {
    view.current!.draws(LASSOS.includes(tool));
    setClicks([]);
  };
  useLayoutEffect(restart, [tool, reading]);

  const change = async (said: Schemas["DrawingPatch"]) => {
    setError(null);
    try {
      const asked = await patch<Schemas["DrawingAccepted"]>(`/v1/drawings/${drawing.id}`, said);
      setJob(asked.job);
      const ended = await follow(asked.job, setJob);
      if (ended.problem) throw new Error(ended.problem.detail);
      reload();
    } catch (cause) {
      setError(cause);
    } finally {
      setJob(null);
      setClicks([]);
    }
  };
  const keyed = (event: KeyboardEvent) => {
    const far = event.shiftKey ? 0.01 : 0.1;
    const step = {
      ArrowLeft: [far, 0, 1],
      ArrowRight: [-far, 0, 1],
      ArrowUp: [0, far, 1],
      ArrowDown: [0, -far, 1],
      "+": [0, 0, 1.25],
      "-": [0, 0, 0.8],
    }[event.key];
    const act = step
      ? () => view.current?.step(step[0]!, step[1]!, step[2]!)
      : event.key === "Enter"
        ? () => view.current?.press()
        : event.key === "Escape"
          ? restart
          : null;
    if (!act) return;
    event.preventDefault();
    if (tool !== "pan") view.current?.aim(true);
    act();
  };
  useLayoutEffect(() => {
    const redone = (event: KeyboardEvent) => {
      if (!(event.ctrlKey || event.metaKey) || event.target instanceof HTMLInputElement) return;
      const key = event.key.toLowerCase();
      const step = key === "z" && !event.shiftKey ? undo : key === "y" || key === "z" ? redo : undefined;
      if (!step) return;
      event.preventDefault();
      step();
    };
    addEventListener("keydown", redone);
    return () => removeEventListener("keydown", redone);
  }, [undo, redo]);
  const measured = (length: number): KnownLength => {
    const [[x1, y1], [x2, y2]] = clicks.map((at) => toFile(reading, at)) as [Point, Point];
    return { x1, y1, x2, y2, length_m: length };
  };
  return (
    <div class="workplace">
      <div class="stack">
        <div class="choices" role="group" aria-label={t("draw.tools")}>
          {TOOLS.map((one) => (
            <button key={one} type="button" aria-pressed={tool === one} onClick={() => setTool(one)}>
              {t(`draw.${one}`)}
            </button>
          ))}
        </div>
        <div class="stage">
          <canvas
            ref={canvas}
            class={`sheet ${tool === "pan" ? "" : "crossed"}`}
            tabIndex={0}
            role="application"
            aria-label={t("draw.title")}
            onKeyDown={keyed}
            onBlur={() => view.current?.aim(false)}
          />
          <div class="choices over">
            <button type="button" aria-label={t("draw.nearer")} onClick={() => view.current?.step(0, 0, 1.4)}>
              +
            </button>
            <button type="button" aria-label={t("draw.farther")} onClick={() => view.current?.step(0, 0, 1 / 1.4)}>
              −
            </button>
            <button type="button" onClick={() => view.current?.fit()}>
              {t("draw.fit")}
            </button>
            {tiles && (
              <button type="button" aria-pressed={pixels} onClick={() => setPixels(!pixels)}>
                {t("draw.pixels")}
              </button>
            )}
          </div>
        </div>
        {tool !== "pan" && <p class="quiet">{LASSOS.includes(tool) ? t("draw.lassoKeys") : t("draw.keys")}</p>}
        <p class="quiet">
          {LASSOS.includes(tool)
            ? t("draw.lassoHelp")
            : tool === "scale"
              ? t("draw.scaleHelp")
              : tool === "addWall"
                ? t("draw.wallHelp")
                : t("draw.panHelp")}
        </p>
      </div>
      <aside class="stack">
        <div aria-live="polite" class="stack">
          {job && <Progress job={job} />}
          <Failure error={error} />
        </div>
        <section class="card" aria-label={t("draw.corrections")}>
          <h2>{t("draw.corrections")}</h2>
          {edits.length === 0 && <p class="quiet">{t("draw.noCorrections")}</p>}
          <ol class="reasons">
            {edits.map((edit, k) => (
              <li key={k}>{wordsOf(edit)}</li>
            ))}
          </ol>
          <div class="chips">
            <button type="button" disabled={!undo} onClick={undo} aria-keyshortcuts="Control+Z" title="Ctrl+Z">
              {t("draw.undo")}
            </button>
            <button type="button" disabled={!redo} onClick={redo} aria-keyshortcuts="Control+Y" title="Ctrl+Y">
              {t("draw.redo")}
            </button>
            <button
              class="primary"
              type="button"
              disabled={!unsaved || job !== null}
              onClick={() => void change({ edits: [...edits] })}
            >
              {t("draw.save")}
            </button>
          </div>
        </section>
        <ScalePanel
          scale={reading.scale}
          clicks={clicks.length}
          measuring={tool === "scale"}
          busy={job !== null}
          measured={(length) => void change({ scale: { known_length: measured(length) } })}
          chosen={(metres) => void change({ scale: { metres_per_unit: metres } })}
        />
        <StrokeLayers strokes={strokes} hidden={hidden} setHidden={setHidden} />
        {!!reading.findings?.length && (
          <section class="card" aria-label={t("draw.findings")}>
            <h2>{t("draw.findings")}</h2>
            <ul class="reasons">
              {reading.findings.map((one, k) => (
                <li key={k} class={one.severity ?? ""}>
                  {one.message}
                </li>
              ))}
            </ul>
          </section>
        )}
        <BuildPanel
          mapId={mapId}
          drawingId={drawing.id}
          blocked={unsaved || job !== null || !strokes.some(isKept) || !reading.scale?.metres_per_unit}
        />
      </aside>
    </div>
  );
}

export default function DrawingPage({ mapId, drawingId }: { mapId: string; drawingId: string }) {
  const { value, error, reload } = useLoaded(() => open(drawingId), [drawingId]);
  const running = value && !value.reading && !value.drawing.job.problem;
  useEffect(() => {
    if (running) void follow(value.drawing.job).then(reload, reload);
    // eslint-disable-next-line react-hooks/exhaustive-deps -- once until it has ended: each load gives a new job
  }, [running]);
  return (
    <>
      <div class="title">
        <h1>{t("draw.title")}</h1>
        {value && <span class="quiet">{value.drawing.file_name}</span>}
        {value?.reading && (
          <span class="quiet">
            {t("draw.confidence")}: {Math.round((value.reading.confidence ?? 0) * 100)} %
          </span>
        )}
        <span class="spread" />
        <a class="button" href={`#/maps/${mapId}`}>
          {t("tablet.back")}
        </a>
      </div>
      <Failure
        error={
          error ??
          (value && !value.reading && value.drawing.job.problem ? new Error(value.drawing.job.problem.detail) : null)
        }
      />
      {!value && !error && <Loading />}
      {running && <p class="none">{t("draw.reading")}…</p>}
      {value?.reading && <Editor {...value} reading={value.reading} mapId={mapId} reload={reload} />}
    </>
  );
}
