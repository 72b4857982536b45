import { t } from "../i18n";

const Person = ({ x, y }: { x: number; y: number }) => (
  <g transform={`translate(${x} ${y})`}>
    <circle r="9" class="stands" />
    <path d="M9 -5L34 0L9 5Z" class="looks" />
  </g>
);

/** How a scan becomes a good one, in three pictures. */
export function HowTo({ begin }: { begin: () => void }) {
  const pictures = [
    {
      words: t("tablet.how1"),
      drawn: (
        <>
          <path d="M130 15V105" class="wall-line" />
          <Person x={50} y={60} />
          <path d="M84 60H126" class="sight-line" />
        </>
      ),
    },
    {
      words: t("tablet.how2"),
      drawn: (
        <>
          <path d="M20 20H140V110" class="wall-line" />
          <path d="M25 104H128" class="floor-line" />
          <Person x={50} y={70} />
          <path d="M84 70H136M60 56L75 24" class="sight-line" />
        </>
      ),
    },
    {
      words: t("tablet.how3"),
      drawn: (
        <>
          <path d="M20 15H140V105H95M65 105H20V15" class="wall-line" />
          <Person x={70} y={60} />
        </>
      ),
    },
  ];
  return (
    <>
      <ol class="how">
        {pictures.map(({ words, drawn }) => (
          <li key={words} class="card">
            <svg viewBox="0 0 160 120" aria-hidden="true">
              {drawn}
            </svg>
            <p>{words}</p>
          </li>
        ))}
      </ol>
      <button class="primary huge" type="button" onClick={begin}>
        {t("tablet.start")}
      </button>
    </>
  );
}
