// @vitest-environment happy-dom
import { expect, it } from "vitest";
import type { DeviceHealth } from "../wire/types";
import { mountUneven } from "./uneven-times";

const told = (text: string): DeviceHealth =>
  ({ jitter_cause: text ? { kind: "stalls", text, remedy: "Check its load." } : null }) as DeviceHealth;

it("shows the cause of uneven times only on demand, and takes no room before", () => {
  const { button, node, update } = mountUneven();
  document.body.append(button, node);
  update(told(""));
  expect([button.style.visibility, node.hidden]).toEqual(["hidden", true]);
  update(told("This host was too busy to read."));
  expect([button.style.visibility, node.hidden]).toEqual(["", true]); // nothing below moves by itself
  button.click();
  expect([button.ariaExpanded, node.hidden]).toEqual(["true", false]);
  expect(node.textContent).toBe("This host was too busy to read. Check its load.");
});

it("stays open when the times are even again, until it is closed", () => {
  const { button, node, update } = mountUneven();
  update(told("This host was too busy to read."));
  button.click();
  update(told(""));
  expect([button.style.visibility, node.hidden, node.textContent]).toEqual(["", false, "Samples arrive evenly again."]);
  button.click();
  expect([button.style.visibility, node.hidden]).toEqual(["hidden", true]);
});
