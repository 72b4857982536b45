import { useEffect, useState } from "preact/hooks";
import { all, get, type Page, type Revision, type SiteMap } from "../api/client";
import { useLoaded } from "../api/useLoaded";
import { kept, newParcel, type Parcel, type Rough } from "../api/parcels";
import { t } from "../i18n";
import { FullStorage } from "../ui/FullStorage";
import { HowTo } from "../ui/HowTo";
import { Failure, Loading } from "../ui/parts";
import { TapPlan, wallsOf, type Walls } from "../view/TapPlan";
import { SentScan } from "./SentScan";

type Step = "how" | "map" | "file" | "where" | "sending";

const latestOf = async (mapId: string): Promise<Revision | null> =>
  (await get<Page<Revision>>(`/v1/revisions?map=${mapId}&status=ready&limit=1`)).items[0] ?? null;

async function wallsFor(mapId: string): Promise<Walls | null> {
  const latest = await latestOf(mapId);
  return latest && wallsOf(await get(`/v1/maps/${mapId}/revisions/${latest.n}/artifacts/walls.geojson`));
}

function Where({ mapId, said }: { mapId: string; said: (rough: Rough | null) => void }) {
  const [rough, setRough] = useState<{ value: Rough; turned: boolean } | null>(null);
  const { value, error } = useLoaded(() => wallsFor(mapId).then((walls) => ({ walls })), [mapId]);
  if (!value) return error ? <Failure error={error} /> : <Loading />;
  if (!value.walls) return <p class="none">{t("place.noMap")}</p>;
  return (
    <>
      <p>{t("tablet.whereHelp")}</p>
      <TapPlan
        walls={value.walls}
        value={rough?.value ?? null}
        turned={rough?.turned ?? false}
        label={t("tablet.where")}
        set={(where, turned) => setRough({ value: where, turned })}
      />
      <div class="chips">
        <button class="huge" type="button" onClick={() => said(null)}>
          {t("tablet.leaveOut")}
        </button>
        <button class="primary huge" type="button" disabled={!rough} onClick={() => said(rough!.value)}>
          {t("tablet.send")}
        </button>
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
        {value?.map((map) => (
          <li key={map.id}>
            <button class="huge" type="button" onClick={() => choose(map)}>
              <span class="quiet">{map.site}</span> {map.name}
            </button>
          </li>
        ))}
      </ul>
    </>
  );
}

export default function TabletPage() {
  const [step, setStep] = useState<Step>("how");
  const [map, setMap] = useState<SiteMap | null>(null);
  const [file, setFile] = useState<File | null>(null);
  const [parcels, setParcels] = useState<Parcel[] | null>(null);
  useEffect(() => {
    if (isSecureContext && "serviceWorker" in navigator)
      void navigator.serviceWorker.register("/tablet-worker.js", { scope: "/tablet" });
    const found = (all: Parcel[]) => {
      setParcels(all);
      if (all.length) setStep("sending");
    };
    kept().then(found, () => found([]));
  }, []);
  const dispatch = async (rough: Rough | null) => {
    const made = await newParcel(map!.id, file!, rough);
    setParcels((others) => [...others!, made]);
    setStep("sending");
  };
  const putAway = (parcel: Parcel) => {
    setParcels((all) => all!.filter((one) => one.once !== parcel.once));
    if (parcels!.length === 1 && step === "sending") setStep("map");
  };
  const titles: Record<Step, string> = {
    how: t("tablet.title"),
    map: t("tablet.map"),
    file: t("tablet.file"),
    where: t("tablet.where"),
    sending: t("tablet.title"),
  };
  const before: Partial<Record<Step, Step>> = { map: "how", file: "map", where: "file" };
  if (!parcels)
    return (
      <main class="tablet">
        <Loading />
      </main>
    );
  return (
    <main class="tablet">
      <div class="title">
        {before[step] && (
          <button type="button" onClick={() => setStep(before[step]!)}>
            ← {t("tablet.back")}
          </button>
        )}
        <h1>{titles[step]}</h1>
        <span class="spread" />
        <a class="button" href="/#/">
          {t("nav.overview")}
        </a>
      </div>
      <FullStorage />
      {step === "how" && <HowTo begin={() => setStep("map")} />}
      {step === "map" && (
        <Chosen
          choose={(one) => {
            setMap(one);
            setStep("file");
          }}
        />
      )}
      {step === "file" && (
        <label class="button primary-look huge">
          {t("tablet.file")}
          <input
            class="hidden"
            type="file"
            onChange={(event) => {
              const picked = event.currentTarget.files?.[0];
              if (picked) {
                setFile(picked);
                setStep("where");
              }
            }}
          />
        </label>
      )}
      {step === "where" && <Where mapId={map!.id} said={(rough) => void dispatch(rough)} />}
      {parcels.map((parcel) => (
        <SentScan key={parcel.once} parcel={parcel} putAway={() => putAway(parcel)} />
      ))}
      {step === "sending" && (
        <button class="huge" type="button" onClick={() => setStep("map")}>
          {t("tablet.another")}
        </button>
      )}
      {!isSecureContext && <p class="quiet">{t("tablet.insecure")}</p>}
    </main>
  );
}
