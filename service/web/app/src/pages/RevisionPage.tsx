import { useEffect, useRef, useState } from "preact/hooks";
import { get, type Revision, type SiteMap } from "../api/client";
import { useLoaded } from "../api/useLoaded";
import { t, whenText } from "../i18n";
import { Failure, Loading } from "../ui/parts";
import { Octree, type MapCloud } from "../view/octree";
import { Picked } from "../view/Picked";
import { Stage, type Place } from "../view/Stage";

interface Loadable {
  map: SiteMap;
  revision: Revision;
  cloud: MapCloud;
}

async function load(mapId: string, n: number): Promise<Loadable> {
  const [map, revision, cloud] = await Promise.all([
    get<SiteMap>(`/v1/maps/${mapId}`),
    get<Revision>(`/v1/maps/${mapId}/revisions/${n}`),
    Octree.open(`/v1/maps/${mapId}/revisions/${n}/artifacts`),
  ]);
  return { map, revision, cloud };
}

function Viewer({ cloud }: { cloud: MapCloud }) {
  const canvas = useRef<HTMLCanvasElement>(null);
  const stage = useRef<Stage | null>(null);
  const [mode, setMode] = useState<"above" | "room">("room");
  const [picked, setPicked] = useState<Place | null>(null);
  useEffect(() => {
    stage.current = new Stage(canvas.current!, { map: cloud, picked: setPicked });
    return () => stage.current?.leave();
  }, [cloud]);
  useEffect(() => stage.current?.look(mode), [mode, cloud]);
  return (
    <div class="stage">
      <canvas
        ref={canvas}
        class="cloud"
        role="img"
        aria-label={`${t("place.map")}: ${mode === "above" ? t("place.above") : t("place.room")}`}
      />
      <div class="choices over" role="group" aria-label={t("place.view")}>
        <button type="button" aria-pressed={mode === "room"} onClick={() => setMode("room")}>
          {t("place.room")}
        </button>
        <button type="button" aria-pressed={mode === "above"} onClick={() => setMode("above")}>
          {t("place.above")}
        </button>
      </div>
      <div class="legend over">
        <span class="of-map">{t("view.hint")}</span>
        <Picked place={picked} />
      </div>
    </div>
  );
}

export default function RevisionPage({ mapId, n }: { mapId: string; n: number }) {
  const { value, error } = useLoaded(() => load(mapId, n), [mapId, n]);
  return (
    <>
      <div class="title">
        <h1>
          {value ? `${value.map.name} · ` : ""}
          {t("revisions.n")} {n}
        </h1>
        {value && <span class="quiet">{whenText(value.revision.created_at)}</span>}
        <span class="spread" />
        <a class="button" href={`#/maps/${mapId}`}>
          {t("tablet.back")}
        </a>
      </div>
      <Failure error={error} />
      {!value && !error && <Loading />}
      {value && <Viewer cloud={value.cloud} />}
    </>
  );
}
