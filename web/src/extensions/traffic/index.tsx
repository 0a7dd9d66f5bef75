/** The traffic log: every frame to and from a device beside its settings, and bytes sent by hand. */
import { registerExtension, type Slots } from "../../extension/extension";
import { late } from "../../ui/dom/late";

const TrafficLog = late(async () => (await import("./log")).TrafficLog);

const TrafficView = (properties: Slots["configureSide"]) => <TrafficLog {...properties} />;

registerExtension({ name: "traffic", views: [{ slot: "configureSide", order: 10, View: TrafficView }] });
