// @vitest-environment happy-dom
/** The page of a fleet in a DOM without a browser: what is listed, and when the list takes another order. */
import { fireEvent, screen, waitFor } from "@testing-library/preact";
import { expect, test } from "vitest";
import { robotWith } from "./fixtures";
import { type Opened, openPage } from "../../../testing/live-page";
import { recorded } from "../../../testing/recorded";
import type { FleetRobots, RobotSummary } from "../../../wire/routes";
import { fleetOf } from "./fleet-state";
import { serverKind } from "../server-kind";
import { find } from "../../../testing/queries";

const PATIENCE = { timeout: 30_000 };
const eventually = (check: () => void): Promise<void> => waitFor(check, PATIENCE);
const rows = (): HTMLElement[] => [...document.querySelectorAll<HTMLElement>(".fleet-row")];
const names = (): string[] => rows().map((row) => row.querySelector("a")?.textContent ?? "");
const numbered = (n: number, part: Partial<RobotSummary> = {}): RobotSummary =>
  robotWith({ name: `amr-${String(n).padStart(3, "0")}`, ...part });

interface OpenedFleet extends Opened {
  /** What the server answers next: what changed, or everything. */
  readonly tell: (robots: readonly RobotSummary[], complete?: boolean) => void;
}

async function openFleet(robots: readonly RobotSummary[], place = "#/fleet", broken?: Response): Promise<OpenedFleet> {
  let revision = 1;
  let next: FleetRobots = { revision, time: 1_700_000_100, complete: true, gone: [], robots };
  const answer = (): unknown => broken?.clone() ?? next;
  const page = await openPage(recorded("library"), { place, answers: { "GET /api/fleet/robots": answer } });
  serverKind(page.app).isFleet.value = true;
  return {
    ...page,
    tell: (changed, complete = false) => {
      next = { revision: ++revision, time: 1_700_000_100 + revision, complete, gone: [], robots: changed };
      fleetOf(page.app).retry();
    },
  };
}

test("of a thousand robots only those in view are in the document", async () => {
  await openFleet(Array.from({ length: 1000 }, (_, i) => numbered(i)));
  await eventually(() => expect(rows().length).toBeGreaterThan(10));
  expect(rows().length).toBeLessThan(60);
  expect(find(".fleet-list").getAttribute("aria-rowcount")).toBe("1001");
});

test("two robots of one name are two rows that say what to do", async () => {
  const same = { same_name: 1, devices: [] };
  await openFleet([numbered(1), numbered(2, same), robotWith({ ...same, name: "amr-002 (2)", pages: "off" })]);
  await eventually(() => expect(names()).toEqual(["amr-002", "amr-002 (2)", "amr-001"]));
  expect(rows()[0]?.textContent).toContain("same name");
  fireEvent.click(rows()[1] as HTMLElement);
  await eventually(() => expect(find(".fleet-details").textContent).toContain("--fleet-name NAME"));
});

test("a count is a filter, and the address holds it with the search", async () => {
  await openFleet([numbered(1), numbered(2, { state: "lost" }), numbered(3, { settings: "drifted", drifted: 2 })]);
  await eventually(() => expect(names()).toEqual(["amr-002", "amr-003", "amr-001"]));
  fireEvent.click(screen.getByRole("button", { name: "1 Drifted" }));
  await eventually(() => expect(names()).toEqual(["amr-003"]));
  expect(location.hash).toBe("#/fleet?show=drifted");
  fireEvent.input(screen.getByRole("searchbox"), { target: { value: "nothing" } });
  await eventually(() => expect(document.body.textContent).toContain("No robot matches"));
  fireEvent.click(screen.getByRole("button", { name: "Show all robots" }));
  await eventually(() => expect(rows().length).toBe(3));
  expect(location.hash).toBe("#/fleet");
});

test("rows do not move under the pointer, and figures change in place", async () => {
  const { app, tell } = await openFleet([numbered(1), numbered(2)], "#/fleet?sort=alarms");
  await eventually(() => expect(names()).toEqual(["amr-001", "amr-002"]));
  const fleet = fleetOf(app);
  fleet.pointer(true);
  const alarms = [
    { name: "Hot", level: "error", state: "raised", device: "", condition: "", acknowledged_by: "" },
  ] as const;
  // however much later: each answer would bring another order
  await eventually(() => {
    tell([numbered(2, { alarms })]);
    expect(fleet.isOutOfOrder.value).toBe(true);
  });
  expect(names()).toEqual(["amr-001", "amr-002"]);
  expect(rows()[1]?.textContent).toContain("alarm");
  fireEvent.keyDown(document.body, { key: "s" });
  await eventually(() => expect(names()).toEqual(["amr-002", "amr-001"]));
  expect(fleet.isOutOfOrder.value).toBe(false);
});

test("keys move through the rows, open one, and Esc closes it", async () => {
  await openFleet([1, 2, 3].map((n) => numbered(n)));
  await eventually(() => expect(rows().length).toBe(3));
  const list = find(".fleet-list");
  for (const key of ["ArrowDown", "ArrowDown", "Enter"]) {
    fireEvent.keyDown(list, { key });
    await Promise.resolve();
  }
  await eventually(() => expect(find(".fleet-details h2").textContent).toBe("amr-002"));
  expect(location.hash).toBe("#/fleet?robot=amr-002");
  expect(list.getAttribute("aria-activedescendant")).toBe("fleet-row-1");
  fireEvent.keyDown(document.body, { key: "Escape" });
  await eventually(() => expect(document.querySelector(".fleet-details")).toBeNull());
});

test("groups are counted and fold", async () => {
  await openFleet(
    [numbered(1), numbered(2, { group: "Orchard", state: "lost" }), numbered(3, { group: "" })],
    "#/fleet?by=group",
  );
  await eventually(() => expect(rows().length).toBe(6));
  const [harbour, , orchard, , none] = rows();
  expect(harbour?.textContent).toContain("Harbour1 robot");
  expect(orchard?.textContent).toContain("1 lost");
  expect(none?.textContent).toContain("No group");
  if (orchard) fireEvent.click(orchard);
  await eventually(() => expect(names().filter(Boolean)).toEqual(["amr-001", "amr-003"]));
});

test("an empty fleet says how a robot joins", async () => {
  const { tell } = await openFleet([]);
  await eventually(() => expect(document.body.textContent).toContain("imuscope serve --fleet tcp/"));
  tell([numbered(1)]);
  await eventually(() => expect(names()).toEqual(["amr-001"]));
});

test("a refusal is said with its reason", async () => {
  const words = { kind: "unauthorized", message: "A token is needed.", hint: "Open the printed address." };
  await openFleet([], "#/fleet", Response.json(words, { status: 401 }));
  await eventually(() => expect(find(".card").textContent).toContain("Access refused"));
  expect(find(".card").textContent).toContain("Open the printed address.");
});

test("without a connection the robots stay, with a word about it", async () => {
  let isDown = false;
  const robots: FleetRobots = { revision: 1, time: 1_700_000_100, complete: true, gone: [], robots: [numbered(1)] };
  const answer = (): unknown => {
    if (isDown) throw new TypeError("Failed to fetch");
    return robots;
  };
  const page = await openPage(recorded("library"), { place: "#/fleet", answers: { "GET /api/fleet/robots": answer } });
  serverKind(page.app).isFleet.value = true;
  await eventually(() => expect(names()).toEqual(["amr-001"]));
  isDown = true;
  fleetOf(page.app).retry();
  await eventually(() => expect(find(".fleet .band").textContent).toContain("No connection to the fleet server"));
  expect(names()).toEqual(["amr-001"]);
  isDown = false;
  fleetOf(page.app).retry();
  await eventually(() => expect(document.querySelector(".fleet .band")).toBeNull());
});

test("a single robot has no fleet", async () => {
  const { asked } = await openPage(recorded("library"), { place: "#/fleet" });
  await eventually(() => expect(document.querySelector(".nav")?.textContent).toBe("LiveConfigureRecordings"));
  expect(asked.filter(({ path }) => path.includes("fleet"))).toEqual([]);
});
