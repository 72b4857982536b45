/** One layer, and what can be planned for it: hide, rename, move, replace, remove. */
import { useState } from "preact/hooks";
import type { Layer, Operation, Placement } from "../api/client";
import { named, t, whenText } from "../i18n";
import { Dialog } from "../ui/parts";

/** A change that is to be made, and what the page calls it. */
export interface Planned {
  operation: Operation;
  words: string;
}

interface LayerRowProps {
  layer: Layer;
  placements: Placement[];
  plan: (one: Planned) => void;
}

interface AskProps extends LayerRowProps {
  close: () => void;
}

function Move({ layer, plan, close }: AskProps) {
  const [by, setBy] = useState({ x_m: 0, y_m: 0, z_m: 0, degrees: 0 });
  const fields = [
    ["x_m", t("place.x"), 0.1],
    ["y_m", t("place.y"), 0.1],
    ["z_m", "z [m]", 0.05],
    ["degrees", t("place.yaw"), 1],
  ] as const;
  const go = (event: Event) => {
    event.preventDefault();
    const { degrees, ...shift } = by;
    const operation: Operation = {
      op: "move-layer",
      layer_id: layer.layer_id,
      by: { ...shift, yaw_rad: (degrees * Math.PI) / 180 },
    };
    plan({ operation, words: `${t("revise.move")}: ${layer.name} (${by.x_m}, ${by.y_m}, ${by.z_m} m, ${degrees}°)` });
    close();
  };
  return (
    <Dialog title={`${t("revise.move")}: ${layer.name}`} close={close}>
      <form onSubmit={go}>
        <p class="quiet">{t("revise.moveHelp")}</p>
        <div class="numbers">
          {fields.map(([name, label, step]) => (
            <label key={name}>
              {label}
              <input
                type="number"
                step={step}
                value={by[name]}
                onInput={(event) => setBy({ ...by, [name]: event.currentTarget.valueAsNumber || 0 })}
              />
            </label>
          ))}
        </div>
        <button class="primary">{t("revise.plan.add")}</button>
      </form>
    </Dialog>
  );
}

function Rename({ layer, plan, close }: AskProps) {
  const [name, setName] = useState(layer.name);
  const go = (event: Event) => {
    event.preventDefault();
    plan({
      operation: { op: "rename-layer", layer_id: layer.layer_id, name: name.trim() },
      words: `${layer.name} → ${name.trim()}`,
    });
    close();
  };
  return (
    <Dialog title={`${t("revise.rename")}: ${layer.name}`} close={close}>
      <form onSubmit={go}>
        <label>
          {t("keys.name")}
          <input value={name} maxLength={200} onInput={(event) => setName(event.currentTarget.value)} />
        </label>
        <button class="primary" disabled={!name.trim() || name.trim() === layer.name}>
          {t("revise.plan.add")}
        </button>
      </form>
    </Dialog>
  );
}

function Replace({ layer, placements, plan, close }: AskProps) {
  const others = placements.filter((one) => one.id !== layer.placement_id);
  const take = (one: Placement) => {
    const operation: Operation = {
      op: "replace-layer",
      layer_id: layer.layer_id,
      placement_id: one.id,
      reviewed: one.verdict !== "accepted",
      part: { points: "target" },
    };
    plan({ operation, words: `${t("revise.replace")}: ${layer.name} (${whenText(one.created_at)})` });
    close();
  };
  return (
    <Dialog title={`${t("revise.replace")}: ${layer.name}`} close={close}>
      {others.length === 0 && <p class="quiet">{t("revise.noOther")}</p>}
      <ul class="list">
        {others.map((one) => (
          <li key={one.id}>
            <img alt="" loading="lazy" src={`/v1/scans/${one.scan_id}/preview.png`} />
            <span>
              {whenText(one.created_at)}
              <span class="quiet">{named("place", one.verdict!)}</span>
            </span>
            <button type="button" onClick={() => take(one)}>
              {t("place.take")}
            </button>
          </li>
        ))}
      </ul>
    </Dialog>
  );
}

const DIALOGS = { move: Move, rename: Rename, replace: Replace };

export function LayerRow(row: LayerRowProps) {
  const { layer, plan } = row;
  const [asked, setAsked] = useState<keyof typeof DIALOGS | null>(null);
  const Asked = asked && DIALOGS[asked];
  const hide = layer.visible ? "hide-layer" : "show-layer";
  const hideWords = layer.visible ? t("revisions.hide") : t("revisions.show");
  return (
    <li>
      <span>
        <strong>{layer.name}</strong>
        {!layer.visible && <span class="quiet">{t("revise.hidden")}</span>}
      </span>
      <span class="chips">
        <button
          type="button"
          onClick={() =>
            plan({ operation: { op: hide, layer_id: layer.layer_id }, words: `${hideWords}: ${layer.name}` })
          }
        >
          {hideWords}
        </button>
        <button type="button" onClick={() => setAsked("move")}>
          {t("revise.move")}
        </button>
        <button type="button" onClick={() => setAsked("replace")}>
          {t("revise.replace")}
        </button>
        <button type="button" onClick={() => setAsked("rename")}>
          {t("revise.rename")}
        </button>
        <button
          type="button"
          onClick={() =>
            plan({
              operation: { op: "remove-layer", layer_id: layer.layer_id },
              words: `${t("revisions.remove")}: ${layer.name}`,
            })
          }
        >
          {t("revisions.remove")}
        </button>
      </span>
      {Asked && <Asked {...row} close={() => setAsked(null)} />}
    </li>
  );
}
