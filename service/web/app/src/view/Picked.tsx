/** The point of the map that was clicked on, in metres. */
import { t } from "../i18n";
import type { Place } from "./Stage";

export const Picked = ({ place }: { place: Place | null }) => (
  <output aria-label={t("view.picked")}>
    {place && `${place.x.toFixed(3)}, ${place.y.toFixed(3)}, ${place.z.toFixed(3)} m`}
  </output>
);
