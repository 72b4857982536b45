/** How large the drawing is: what says so, where the witnesses disagree, and a length measured by two clicks. */
import { useState } from "preact/hooks";
import type { Scale, Schemas } from "../api/client";
import { named, t } from "../i18n";
import { Chip } from "../ui/parts";
import { offBy } from "../view/sheet";

export type KnownLength = Schemas["KnownLengthIn"];

interface ScalePanelProps {
  scale: Scale | null;
  clicks: number;
  measuring: boolean;
  busy: boolean;
  measured: (lengthM: number) => void;
  chosen: (metresPerUnit: number) => void;
}

const TONES = { given: "good", found: "good", unknown: "bad" } as const;
const UNITS = { m: 1, cm: 0.01, mm: 0.001, ft: 0.3048, in: 0.0254 } as const;
const unitText = (metres: number) => `${metres.toPrecision(5)} m`;

export function ScalePanel({ scale, clicks, measuring, busy, measured, chosen }: ScalePanelProps) {
  const [length, setLength] = useState("");
  const [unit, setUnit] = useState<keyof typeof UNITS>("m");
  const perUnit = scale?.metres_per_unit ?? null;
  const state = scale?.state ?? "unknown";
  const metres = Number(length.replace(",", ".")) * UNITS[unit];
  const go = (event: Event) => {
    event.preventDefault();
    measured(metres);
  };
  return (
    <section class="card" aria-label={t("draw.scaleIs")}>
      <div class="title">
        <h2>{t("draw.scaleIs")}</h2>
        <Chip tone={TONES[state]}>{named("scale", state)}</Chip>
      </div>
      <p>{perUnit ? `${unitText(perUnit)} / ${t("draw.unit")}` : t("draw.unknown")}</p>
      <ul class="reasons">
        {scale?.witnesses?.map((one, k) => {
          const off = perUnit && one.metres_per_unit ? offBy(perUnit, one.metres_per_unit) : 0;
          return (
            <li key={k}>
              {one.kind}: {one.detail}
              {Math.abs(off) > 2 && (
                <strong>
                  {" "}
                  ({off > 0 ? "+" : ""}
                  {off.toFixed(1)} %)
                </strong>
              )}
            </li>
          );
        })}
      </ul>
      {state === "unknown" &&
        scale?.candidates?.map(
          ({ metres_per_unit: said, witnesses }) =>
            said !== null && (
              <button key={said} type="button" disabled={busy} onClick={() => chosen(said)}>
                {unitText(said)} ({witnesses?.join(", ")})
              </button>
            ),
        )}
      {measuring && (
        <form onSubmit={go}>
          <label>
            {t("draw.length")} [{unit}]
            <input
              inputmode="decimal"
              value={length}
              disabled={clicks < 2}
              onInput={(event) => setLength(event.currentTarget.value)}
            />
          </label>
          <select
            aria-label={t("draw.lengthUnit")}
            value={unit}
            onChange={(event) => setUnit(event.currentTarget.value as keyof typeof UNITS)}
          >
            {Object.keys(UNITS).map((name) => (
              <option key={name}>{name}</option>
            ))}
          </select>
          <button class="primary" disabled={busy || clicks < 2 || !(metres > 0)}>
            {t("draw.apply")}
          </button>
        </form>
      )}
    </section>
  );
}
