/** What was kept and what was set aside, by layer and reason; each layer can be hidden. */
import { t } from "../i18n";
import { colourOf } from "../view/SheetView";
import { KEPT, reasonOf, type Stroke } from "../view/sheet";

const MOST_REASONS = 20;

interface StrokeLayersProps {
  strokes: readonly Stroke[];
  hidden: ReadonlySet<string>;
  setHidden: (hidden: ReadonlySet<string>) => void;
}

interface ReasonsProps {
  of: readonly Stroke[];
  hidden: ReadonlySet<string>;
  turn: (name: string) => void;
}

/** Why these strokes are in their layer; of several reasons each can be hidden. */
function Reasons({ of, hidden, turn }: ReasonsProps) {
  const byReason = [...Map.groupBy(of, reasonOf)].slice(0, MOST_REASONS);
  if (byReason.length === 1) return <span class="quiet">{of[0]!.reason}</span>;
  return (
    <details>
      <summary>
        {byReason.length} {t("draw.reasons")}
      </summary>
      {byReason.map(([name, strokes]) => (
        <label key={name} class="line">
          <input type="checkbox" checked={!hidden.has(name)} onChange={() => turn(name)} />
          {strokes[0]!.reason} ({strokes.length})
        </label>
      ))}
    </details>
  );
}

export function StrokeLayers({ strokes, hidden, setHidden }: StrokeLayersProps) {
  const byLayer = [...Map.groupBy(strokes, (one) => one.layer)].sort(
    ([a], [b]) => Number(KEPT.includes(b)) - Number(KEPT.includes(a)) || (a < b ? -1 : 1),
  );
  const turn = (name: string) => {
    const next = new Set(hidden);
    if (!next.delete(name)) next.add(name);
    setHidden(next);
  };
  return (
    <section class="card" aria-label={t("draw.layers")}>
      <h2>{t("draw.layers")}</h2>
      {byLayer.map(([layer, of]) => (
        <div key={layer} class="stroke-layer">
          <label class="line">
            <input type="checkbox" checked={!hidden.has(layer)} onChange={() => turn(layer)} />
            <span class="swatch" style={{ background: colourOf(layer) }} />
            {layer} ({of.length}){KEPT.includes(layer) ? ` · ${t("draw.kept")}` : ""}
          </label>
          <Reasons of={of} hidden={hidden} turn={turn} />
        </div>
      ))}
    </section>
  );
}
