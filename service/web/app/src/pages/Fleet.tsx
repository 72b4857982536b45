import { useState } from "preact/hooks";
import { all, get, type Convergence, type Robot, type Session, type SiteMap } from "../api/client";
import { useFleetEvents } from "../api/useFleetEvents";
import { useLoaded } from "../api/useLoaded";
import { named, t, whenText } from "../i18n";
import { Chip } from "../ui/parts";
import { Rows, type Column } from "../ui/Rows";
import { Matrix } from "./Matrix";
import { RobotHistory } from "./RobotHistory";
import { Rollouts } from "./Rollouts";

const TONES: Record<string, string> = {
  "up-to-date": "good",
  failed: "bad",
  "not-begun": "busy",
  "not-enabled": "busy",
};

export function Fleet({ session }: { session: Session }) {
  const [behind, setBehind] = useState(false);
  const [round, setRound] = useState(0);
  useFleetEvents(() => setRound((n) => n + 1));
  const [shown, setShown] = useState<Robot | null>(null);
  const fleet = useLoaded(() => get<Convergence>("/v1/convergence"), [round]);
  const maps = useLoaded(() => all<SiteMap>("/v1/maps"));
  const nameOf = (id: string) => {
    const map = maps.value?.find((one) => one.id === id);
    return map ? `${map.site} · ${map.name}` : id;
  };
  const columns: Column<Robot>[] = [
    {
      name: t("fleet.robot"),
      width: "minmax(8rem, 1.2fr)",
      show: (robot) => (
        <button class="link" type="button" onClick={() => setShown(robot)}>
          {robot.name}
        </button>
      ),
    },
    {
      name: t("fleet.map"),
      width: "minmax(8rem, 1.5fr)",
      show: (robot) => <a href={`#/maps/${robot.map_id}`}>{nameOf(robot.map_id)}</a>,
    },
    { name: t("fleet.runs"), width: "6rem", show: (robot) => robot.enabled_revision ?? "–" },
    { name: t("fleet.wanted"), width: "6rem", show: (robot) => robot.wanted_revision ?? "–" },
    {
      name: t("fleet.progress"),
      width: "10rem",
      show: (robot) => <Chip tone={TONES[robot.progress] ?? "quiet"}>{named("progress", robot.progress)}</Chip>,
    },
    {
      name: t("fleet.seen"),
      width: "minmax(10rem, 1fr)",
      show: (robot) =>
        (robot.remark && `${t("fleet.remark")}: ${robot.remark}`) ??
        robot.detail ??
        (robot.reported_at ? whenText(robot.reported_at) : "–"),
    },
  ];
  return (
    <>
      <div class="title">
        <h1>{t("nav.fleet")}</h1>
      </div>
      {fleet.value && <Matrix fleet={fleet.value} nameOf={nameOf} />}
      {maps.value && <Rollouts maps={maps.value} round={round} admin={session.role === "admin"} />}
      <div class="title">
        <h2>{t("overview.robots")}</h2>
        <button type="button" aria-pressed={behind} onClick={() => setBehind(!behind)}>
          {t("fleet.onlyBehind")}
        </button>
      </div>
      <Rows
        key={String(behind)}
        label={t("nav.fleet")}
        path={`/v1/robots${behind ? "?behind=true" : ""}`}
        columns={columns}
        keyOf={(robot) => robot.id}
        refresh={round}
        none={t("fleet.none")}
      />
      {shown && <RobotHistory robot={shown} close={() => setShown(null)} />}
    </>
  );
}
