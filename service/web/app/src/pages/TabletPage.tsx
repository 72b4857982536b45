import { useEffect, useRef, useState } from "preact/hooks";
import { all, follow, get, post, type Job, type Page, type Placement, type Revision, type Scan, type Schemas, type SiteMap } from "../api/client";
import { useLoaded } from "../api/live";
import { deliver, forget, keep, kept, newParcel, type Parcel, type Rough } from "../api/tus";
import { bytesText, named, t } from "../i18n";
import { Chip, Failure, Loading, Progress } from "../ui/parts";
import { HowTo } from "../ui/HowTo";
import { loadCloud, type Cloud } from "../view/cloud";
import { Octree } from "../view/octree";
import { MiniPlan } from "../view/MiniPlan";
import { TapPlan, wallsOf, type Walls } from "../view/TapPlan";

type Step = "how" | "map" | "file" | "where" | "sending";

interface Sight {
  map: Cloud;
  scan: Cloud;
}

const latestOf = async (mapId: string): Promise<Revision | null> =>
  (await get<Page<Revision>>(`/v1/revisions?map=${mapId}&status=ready&limit=1`)).items[0] ?? null;

async function wallsFor(mapId: string): Promise<Walls | null> {
  const latest = await latestOf(mapId);
  return latest && wallsOf(await get(`/v1/maps/${mapId}/revisions/${latest.n}/artifacts/walls.geojson`));
}

/** Place a scan where it is said to be, and everywhere if it does not fit there. */
async function placed(scan: Scan, watch: (job: Job) => void): Promise<Placement> {
  const before = await all<Placement>(`/v1/scans/${scan.id}/placements`);
  const judged = before.sort((a, b) => (a.id < b.id ? 1 : -1)).find((one) => one.verdict);
  if (judged) return judged;
  const place = async (body: Record<string, unknown>) => {
    const asked = await post<Schemas["PlacementWithJob"]>(`/v1/scans/${scan.id}/placements`, body);
    watch(asked.job);
    const ended = await follow(asked.job, watch);
    if (ended.problem) throw new Error(ended.problem.detail);
    return get<Placement>(`/v1/placements/${asked.placement.id}`);
  };
  const first = await place({});
  return first.verdict === "rejected" && scan.rough_pose ? place({ search: true }) : first;
}

function Sending({ parcel, again }: { parcel: Parcel; again: () => void }) {
  const [bytes, setBytes] = useState(0);
  const [waiting, setWaiting] = useState(false);
  const [job, setJob] = useState<Job | null>(null);
  const [placement, setPlacement] = useState<Placement | null>(null);
  const [sight, setSight] = useState<Sight | null>(null);
  const [taken, setTaken] = useState<Job | null>(null);
  const [error, setError] = useState<unknown>(null);
  const stop = useRef(new AbortController());

  const run = async (signal: AbortSignal) => {
    const scanId = parcel.scanId ?? (await deliver(parcel, { sent: setBytes, waiting: setWaiting }, signal));
    signal.throwIfAborted();
    setBytes(parcel.size);
    if (!parcel.scanId) await keep({ ...parcel, file: null, scanId });
    const sent = await get<Scan>(`/v1/scans/${scanId}`);
    setJob(sent.job);
    const read = await follow(sent.job, setJob);
    if (read.problem) throw new Error(read.problem.detail);
    const scan = await get<Scan>(`/v1/scans/${scanId}`);
    const found = await placed(scan, setJob);
    setJob(null);
    setPlacement(found);
    const artifacts = `/v1/maps/${scan.map_id}/revisions/${found.revision}/artifacts`;
    const [{ overview }, points] = await Promise.all([Octree.open(artifacts), loadCloud(scan.files.points!)]);
    setSight({ map: overview, scan: points });
  };
  useEffect(() => {
    const { signal } = stop.current;
    run(signal).catch((cause: unknown) => {
      if (!signal.aborted) setError(cause);
    });
    return () => stop.current.abort();
  }, []);

  const confirm = async () => {
    try {
      const asked = await post<Schemas["RevisionWithJob"]>(`/v1/placements/${placement!.id}/accept`, { reviewed: placement!.verdict !== "accepted" });
      await forget();
      setTaken(asked.job);
      setTaken(await follow(asked.job, setTaken));
    } catch (cause) {
      setError(cause);
    }
  };
  const drop = () => {
    stop.current.abort();
    void forget().then(again);
  };
  const percent = Math.floor((100 * bytes) / Math.max(1, parcel.size));
  const words = { accepted: t("tablet.done"), "needs-review": t("tablet.look"), rejected: t("tablet.bad") };
  return (
    <section class="card">
      <h2>{parcel.name}</h2>
      {bytes < parcel.size && (
        <div class="progress">
          <progress max={100} value={percent} aria-label={t("tablet.sending")} />
          <span role="status">{waiting ? t("tablet.waitingForNet") : `${t("tablet.sending")}: ${percent} % · ${bytesText(bytes)} / ${bytesText(parcel.size)}`}</span>
        </div>
      )}
      {job && <div role="status"><strong>{named("kind", job.kind)}</strong><Progress job={job} /></div>}
      {placement && !taken && (
        <>
          <p class="big-words" role="status">{words[placement.verdict!]}</p>
          <Chip tone={placement.verdict === "accepted" ? "good" : placement.verdict === "rejected" ? "bad" : "busy"}>{named("place", placement.verdict!)}</Chip>
          {sight && placement.T_map_scan && <div class="sight"><MiniPlan map={sight.map} scan={sight.scan} T={placement.T_map_scan} label={`${t("place.map")}, ${t("place.scan")}`} /></div>}
          <ul class="reasons">{placement.reasons?.map((reason) => <li key={reason}>{reason}</li>)}</ul>
          {placement.verdict !== "rejected" && <button class="primary huge" type="button" onClick={() => void confirm()}>{t("tablet.confirm")}</button>}
          <a class="button huge" href={`/#/maps/${parcel.mapId}/scans/${placement.scan_id}`}>{t("tablet.move")}</a>
        </>
      )}
      {taken && <div role="status"><p class="done">{taken.state === "succeeded" ? `${t("place.made")} ✓` : t("tablet.taken")}</p>{taken.state !== "succeeded" && <Progress job={taken} />}</div>}
      {taken?.problem && <p class="failure">{taken.problem.detail}</p>}
      <Failure error={error} />
      {taken ? <button class="huge" type="button" onClick={again}>{t("tablet.another")}</button> : <button class="huge" type="button" onClick={drop}>{placement ? t("tablet.another") : t("tablet.giveUp")}</button>}
    </section>
  );
}

function Where({ mapId, said }: { mapId: string; said: (rough: Rough | null) => void }) {
  const [rough, setRough] = useState<{ value: Rough; turned: boolean } | null>(null);
  const { value, error } = useLoaded(() => wallsFor(mapId).then((walls) => ({ walls })), [mapId]);
  if (!value) return error ? <Failure error={error} /> : <Loading />;
  if (!value.walls) return <p class="none">{t("place.noMap")}</p>;
  return (
    <>
      <p>{t("tablet.whereHelp")}</p>
      <TapPlan walls={value.walls} value={rough?.value ?? null} turned={rough?.turned ?? false} label={t("tablet.where")}
        set={(where, turned) => setRough({ value: where, turned })} />
      <div class="chips">
        <button class="huge" type="button" onClick={() => said(null)}>{t("tablet.leaveOut")}</button>
        <button class="primary huge" type="button" disabled={!rough} onClick={() => said(rough!.value)}>{t("tablet.send")}</button>
      </div>
    </>
  );
}

function Chosen({ choose }: { choose: (map: SiteMap) => void }) {
  const { value, error } = useLoaded(() => all<SiteMap>("/v1/maps"));
  return (
    <>
      <Failure error={error} />
      {!value && !error && <Loading />}
      <ul class="big-choice">
        {value?.map((map) => <li key={map.id}><button class="huge" type="button" onClick={() => choose(map)}><span class="quiet">{map.site}</span> {map.name}</button></li>)}
      </ul>
    </>
  );
}

export default function TabletPage() {
  const [step, setStep] = useState<Step>("how");
  const [map, setMap] = useState<SiteMap | null>(null);
  const [file, setFile] = useState<File | null>(null);
  const [parcel, setParcel] = useState<Parcel | null>(null);
  const [looked, setLooked] = useState(false);
  useEffect(() => {
    if (isSecureContext && "serviceWorker" in navigator) void navigator.serviceWorker.register("/tablet-worker.js", { scope: "/tablet" });
    void kept().then((found) => {
      if (found) {
        setParcel(found);
        setStep("sending");
      }
      setLooked(true);
    });
  }, []);
  const dispatch = async (rough: Rough | null) => {
    const made = newParcel(map!.id, file!, rough);
    await keep(made);
    setParcel(made);
    setStep("sending");
  };
  const anew = () => {
    setParcel(null);
    setFile(null);
    setStep("map");
  };
  const titles: Record<Step, string> = { how: t("tablet.title"), map: t("tablet.map"), file: t("tablet.file"), where: t("tablet.where"), sending: t("tablet.title") };
  const before: Partial<Record<Step, Step>> = { map: "how", file: "map", where: "file" };
  if (!looked) return <main class="tablet"><Loading /></main>;
  return (
    <main class="tablet">
      <div class="title">
        {before[step] && <button type="button" onClick={() => setStep(before[step]!)}>← {t("tablet.back")}</button>}
        <h1>{titles[step]}</h1><span class="spread" />
        <a class="button" href="/#/">{t("nav.overview")}</a>
      </div>
      {step === "how" && <HowTo begin={() => setStep("map")} />}
      {step === "map" && <Chosen choose={(one) => { setMap(one); setStep("file"); }} />}
      {step === "file" && (
        <label class="button primary-look huge">{t("tablet.file")}
          <input class="hidden" type="file" onChange={(event) => {
            const picked = event.currentTarget.files?.[0];
            if (picked) { setFile(picked); setStep("where"); }
          }} />
        </label>
      )}
      {step === "where" && <Where mapId={map!.id} said={(rough) => void dispatch(rough)} />}
      {step === "sending" && parcel && <Sending key={parcel.once} parcel={parcel} again={anew} />}
      {!isSecureContext && <p class="quiet">{t("tablet.insecure")}</p>}
    </main>
  );
}
