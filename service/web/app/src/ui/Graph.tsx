/** Which revision was made from which: one lane, and a new one wherever two were made from the same. */
import type { Revision } from "../api/client";
import { named, t, whenText } from "../i18n";

const [STEP, LANE, LEFT] = [34, 22, 16];

interface Node {
  revision: Revision;
  lane: number;
  row: number;
}

/** Newest first; a child goes on in its parent's lane unless that is taken. */
export function lanesOf(revisions: readonly Revision[]): Node[] {
  const oldest = [...revisions].sort((a, b) => a.n - b.n);
  const lanes = new Map<number, number>();
  const continued = new Set<number>();
  let free = 0;
  for (const { n, parent_n: parent } of oldest) {
    const straight = parent !== null && lanes.has(parent) && !continued.has(parent);
    lanes.set(n, straight ? lanes.get(parent)! : free++);
    if (parent !== null) continued.add(parent);
  }
  return oldest.map((revision, k) => ({ revision, lane: lanes.get(revision.n)!, row: oldest.length - 1 - k }));
}

export function Graph({ revisions, published }: { revisions: readonly Revision[]; published: number | null }) {
  const nodes = lanesOf(revisions);
  const placed = new Map(nodes.map((node) => [node.revision.n, node]));
  const wide = LEFT * 2 + LANE * Math.max(0, ...nodes.map((node) => node.lane));
  const at = (node: Node) => [LEFT + node.lane * LANE, STEP / 2 + node.row * STEP] as const;
  return (
    <div class="graph">
      <svg width={wide} height={STEP * nodes.length} aria-hidden="true">
        {nodes.map((node) => {
          const parent = node.revision.parent_n === null ? undefined : placed.get(node.revision.parent_n);
          if (!parent) return null;
          const [[x, y], [px, py]] = [at(node), at(parent)];
          return (
            <path key={node.revision.n} class="edge" d={`M${x} ${y}C${x} ${y + STEP} ${px} ${py - STEP} ${px} ${py}`} />
          );
        })}
        {nodes.map((node) => (
          <circle
            key={node.revision.n}
            class={`node ${node.revision.n === published ? "live-node" : node.revision.status}`}
            cx={at(node)[0]}
            cy={at(node)[1]}
            r={7}
          />
        ))}
      </svg>
      <ol>
        {[...nodes]
          .sort((a, b) => a.row - b.row)
          .map(({ revision }) => (
            <li key={revision.n}>
              <strong>{revision.n}</strong> {named("revision", revision.status)} · {whenText(revision.created_at)}{" "}
              {" · "}
              <code>{revision.created_by}</code>
              {revision.reason && ` · ${revision.reason}`}
              {revision.parent_n !== null && ` · ${t("revisions.from")} ${revision.parent_n}`}
            </li>
          ))}
      </ol>
    </div>
  );
}
