/** One profile for several devices, under the comparison of two states. */
import { registerExtension, type Slots } from "../../extension/extension";
import { late } from "../../ui/dom/late";

const Rollout = late(async () => (await import("./rollout")).RolloutSection);

const RolloutView = (properties: Slots["comparisonActions"]) => <Rollout {...properties} />;

registerExtension({
  name: "rollouts",
  views: [{ slot: "comparisonActions", order: 10, View: RolloutView }],
});
