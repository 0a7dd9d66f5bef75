import { expect, it } from "vitest";
import { signal } from "@preact/signals";
import { capabilities } from "../wire/capabilities";
import { protocol } from "../testing/capabilities";
import type { Deps } from "../page/context";
import { type PanelDefinition, panelsAt, registerPanel } from "./registry";

const panel = (id: string, order: number, applies?: PanelDefinition["applies"]): PanelDefinition => ({
  id,
  title: id,
  where: "below",
  order,
  ...(applies ? { applies } : {}),
  mount: () => ({ update: () => undefined, dispose: () => undefined }),
});
const deps = {
  store: { devices: signal([{ id: "1", protocol: "one" }]) },
  viewState: { device: signal("1") },
} as unknown as Deps;

it("panels of an area are in order, where they apply, with unique ids", () => {
  let applies = false;
  registerPanel(panel("second", 20));
  registerPanel(panel("first", 10));
  registerPanel(panel("sometimes", 15, () => applies));
  registerPanel({ ...panel("elsewhere", 0), where: "side" });
  expect(panelsAt("below", deps).map(({ id }) => id)).toEqual(["first", "second"]);
  applies = true;
  expect(panelsAt("below", deps).map(({ id }) => id)).toEqual(["first", "sometimes", "second"]);
  expect(() => registerPanel(panel("first", 0))).toThrow("first");
});

it("panels named by the protocol of a device come first", () => {
  registerPanel({ ...panel("plain", 10), where: "strip" });
  registerPanel({ ...panel("favourite", 20), where: "strip" });
  expect(panelsAt("strip", deps).map(({ id }) => id)).toEqual(["plain", "favourite"]);
  capabilities.value = {
    ...capabilities.peek(),
    protocols: [protocol({ name: "one", panels: ["favourite"] })],
  };
  expect(panelsAt("strip", deps).map(({ id }) => id)).toEqual(["favourite", "plain"]);
});
