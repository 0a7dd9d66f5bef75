/** The track as a panel of its own, as large as a person makes it. Hidden until a person shows it. */
import { positionOf } from "../attitude/position";
import { TEXT } from "../texts/panels";
import { latePanel } from "../ui/late-panel";
import { channelsOf } from "./panel-context";
import { registerPanel } from "./registry";

registerPanel({
  id: "track",
  title: TEXT.track,
  where: "main",
  height: "high",
  order: 26,
  class: "large-track",
  optional: true,
  applies: (deps) => positionOf(channelsOf(deps)) !== undefined,
  mount: (host, deps) =>
    latePanel(async () => {
      const { mountLargeTrack } = await import("../attitude/track-dialog");
      return () => mountLargeTrack(host, { ...deps, store: deps.samples?.drawn ?? deps.store });
    }),
});
