/** What was kept and what was set aside, by layer and reason; each layer can be hidden. */
import { t } from "../i18n";
import { colourOf } from "../view/SheetView";
import { KEPT, type Stroke } from "../view/sheet";

interface StrokeLayersProps {
  strokes: readonly Stroke[];
  hidden: ReadonlySet<string>;
  setHidden: (hidden: ReadonlySet<string>) => void;
}

export function StrokeLayers({ strokes, hidden, setHidden }: StrokeLayersProps) {
  const byLayer = [...Map.groupBy(strokes, (one) => one.layer)].sort(([a], [b]) => Number(KEPT.includes(b)) - Number(KEPT.includes(a)) || (a < b ? -1 : 1));
  const turn = (layer: string) => {
    const next = new Set(hidden);
    if (!next.delete(layer)) next.add(layer);
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
          <span class="quiet">{[...new Set(of.map((one) => one.reason))].slice(0, 3).join("; ")}</span>
        </div>
      ))}
    </section>
  );
}
