import { lazy, Suspense } from "preact/compat";
import { useEffect, useState } from "preact/hooks";
import { get, Refused, type Session } from "./api/client";
import { named } from "./i18n";
import { Audit } from "./pages/Audit";
import { ComparePage } from "./pages/ComparePage";
import { Fleet } from "./pages/Fleet";
import { Jobs } from "./pages/Jobs";
import { Keys } from "./pages/Keys";
import { MapPage } from "./pages/MapPage";
import { Overview } from "./pages/Overview";
import { RevisePage } from "./pages/RevisePage";
import { SignIn } from "./pages/SignIn";
import { System } from "./pages/System";
import { Shell } from "./ui/Shell";
import { Failure, Loading } from "./ui/parts";

const PlacementPage = lazy(() => import("./pages/PlacementPage"));
const RevisionPage = lazy(() => import("./pages/RevisionPage"));
const DrawingPage = lazy(() => import("./pages/DrawingPage"));
const TabletPage = lazy(() => import("./pages/TabletPage"));

function usePath(): string[] {
  const read = () => location.hash.replace(/^#\/?/, "").split("/").filter(Boolean).map(decodeURIComponent);
  const [path, setPath] = useState(read);
  useEffect(() => {
    const changed = () => {
      setPath(read());
      document.getElementById("content")?.focus();
    };
    addEventListener("hashchange", changed);
    return () => removeEventListener("hashchange", changed);
  }, []);
  return path;
}

function pageOf(path: string[], session: Session) {
  const [first, id, second, third, fourth] = path;
  if (first === "maps" && id && second === "scans" && third)
    return <PlacementPage key={third} mapId={id} scanId={third} />;
  if (first === "maps" && id && second === "drawings" && third)
    return <DrawingPage key={third} mapId={id} drawingId={third} />;
  if (first === "maps" && id && second === "revisions" && third)
    return <RevisionPage key={third} mapId={id} n={Number(third)} />;
  if (first === "maps" && id && second === "revise") return <RevisePage mapId={id} />;
  if (first === "maps" && id && second === "compare")
    return <ComparePage mapId={id} from={Number(third)} to={Number(fourth)} />;
  if (first === "maps" && id) return <MapPage key={id} mapId={id} session={session} />;
  if (first === "jobs") return <Jobs />;
  if (first === "fleet") return <Fleet session={session} />;
  if (first === "audit" && session.role === "admin") return <Audit />;
  if (first === "keys" && session.role === "admin" && !session.map_ids) return <Keys />;
  if (first === "system") return <System />;
  return <Overview session={session} />;
}

export function App() {
  const [session, setSession] = useState<Session | null | undefined>(undefined);
  const [error, setError] = useState<unknown>(null);
  const [, setLanguage] = useState(0);
  const path = usePath();
  useEffect(() => {
    get<Session>("/v1/session").then(setSession, (cause: unknown) => {
      if (cause instanceof Refused && cause.status === 401) setSession(null);
      else setError(cause);
    });
  }, []);
  const tablet = location.pathname === "/tablet";
  const unreachable = error !== null && !(error instanceof Refused);
  if (tablet && unreachable)
    return (
      <Suspense fallback={<Loading />}>
        <TabletPage />
      </Suspense>
    );
  if (error)
    return (
      <main class="narrow">
        <Failure error={error} />
      </main>
    );
  if (session === undefined)
    return (
      <main class="narrow">
        <Loading />
      </main>
    );
  if (session === null) return <SignIn signedIn={setSession} />;
  if (tablet && session.role !== "robot")
    return (
      <Suspense fallback={<Loading />}>
        <TabletPage />
      </Suspense>
    );
  return (
    <Shell
      session={session}
      path={path}
      signedOut={() => setSession(null)}
      languageChanged={() => setLanguage((n) => n + 1)}
    >
      {session.role === "robot" ? (
        <p>{named("noPage", "robot")}</p>
      ) : (
        <Suspense fallback={<Loading />}>{pageOf(path, session)}</Suspense>
      )}
    </Shell>
  );
}
