// @vitest-environment happy-dom
/** The panel of satellites on the page of a receiver, and of a device without one. */
import { act, screen, waitFor } from "@testing-library/preact";
import { expect, test } from "vitest";
import { type Opened, openPage } from "../../testing/live-page";
import { recorded } from "../../testing/recorded";

/** Number, strength and use of each satellite, as sent last. */
function sent({ store }: Opened): readonly string[] {
  const channel = store.channels.value.find(({ info }) => info.name.includes("GPS1_SAT"));
  if (channel === undefined) throw new Error("no satellites were recorded");
  const { ring, info } = channel;
  const at = (name: string): number => info.columns.findIndex((column) => column.name === name);
  const last = ring.length - 1;
  const found: string[] = [];
  for (let k = last; k >= 0 && ring.arrival(k) === ring.arrival(last); k--)
    found.push(`${ring.value(at("svId"), k)} ${ring.value(at("cno"), k)} ${(ring.value(at("status"), k) >> 3) & 1}`);
  return found.sort();
}

test("satellites are shown as sent", async () => {
  const page = await openPage(recorded("isb"));
  const shown = (): readonly string[] =>
    [...document.querySelectorAll(".sky tr[data-use]")]
      .map((row) => {
        const [id, , strength, use] = [...row.children];
        const used = use?.textContent?.trim() === "used" ? 1 : 0;
        return `${Number(id?.textContent?.replace(/\D/g, ""))} ${Number(strength?.firstChild?.textContent)} ${used}`;
      })
      .sort();
  await waitFor(() => expect(shown().length).toBeGreaterThan(5));
  await waitFor(() => expect(shown()).toEqual(sent(page)));
  const table = screen.getByRole("table", { name: /Satellites by constellation/ });
  expect(table.querySelectorAll("[role=rowheader]").length).toBe(shown().length);
  expect(table.textContent).toContain("used");
});

test("a device without a receiver has no satellite panel, also after one that has", async () => {
  const page = await openPage(recorded("isb"));
  await waitFor(() => expect(document.querySelector(".sky")).not.toBeNull());
  const [device] = page.store.devices.value;
  if (device === undefined) throw new Error("no device");
  await act(() => {
    page.store.receive({ kind: "text", text: { op: "devices", devices: [device, { ...device, id: "2" }] } });
    page.look("2");
  });
  await waitFor(() => expect(document.querySelector(".sky")).toBeNull());
});
