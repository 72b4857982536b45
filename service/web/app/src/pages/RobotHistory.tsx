/** What a robot reported, newest first. */
import { get, type Page, type Robot, type Schemas } from "../api/client";
import { useLoaded } from "../api/useLoaded";
import { named, t, whenText } from "../i18n";
import { Dialog, Failure, Loading } from "../ui/parts";

export function RobotHistory({ robot, close }: { robot: Robot; close: () => void }) {
  const { value, error } = useLoaded(
    () => get<Page<Schemas["ReportOut"]>>(`/v1/robots/${robot.id}/reports?limit=100`),
    [robot.id],
  );
  return (
    <Dialog title={`${robot.name}: ${t("fleet.history")}`} close={close}>
      <Failure error={error} />
      {robot.remark && (
        <p>
          {t("fleet.remark")}: {robot.remark}
        </p>
      )}
      {!value && !error && <Loading />}
      {value?.items.length === 0 && <p class="quiet">{t("fleet.noReports")}</p>}
      <ol class="reasons">
        {value?.items.map((one) => (
          <li key={one.id}>
            {whenText(one.at)} · {t("fleet.revision")} {one.revision} · {named("robot", one.state)}
            {one.detail && ` · ${one.detail}`}
          </li>
        ))}
      </ol>
    </Dialog>
  );
}
