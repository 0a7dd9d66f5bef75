// @vitest-environment happy-dom
/** The export dialog shows length, channels and format before it exports. */
import { fireEvent, render, screen, waitFor } from "@testing-library/preact";
import { expect, test, vi } from "vitest";
import type { Store } from "../../data/store";
import type { RecordingDetail, RecordingInfo } from "../../wire/recording-types";
import { newApp } from "../../testing/live-page";
import { answering, type Asked, recorded } from "../../testing/recorded";
import { capabilities } from "../../wire/capabilities";
import type { ExportCapability } from "../../wire/capability-types";
import type { ExportJob } from "../../wire/types";
import { ExportDialog } from "./export-dialog";

const FIRST = 1_760_000_000;
const form = (name: string, title: string): ExportCapability =>
  ({ name, title, words: "", single: false, protocol: "", takes_units: name === "csv" }) as unknown as ExportCapability;
const job: ExportJob = {
  id: 1,
  recording: "yard",
  title: "CSV",
  file: "yard.csv.zip",
  state: "running",
  progress: 0.5,
  size: 0,
  message: "",
  hint: "",
} as unknown as ExportJob;

function open(): { readonly asked: readonly Asked[]; readonly store: Store } {
  const [info] = recorded("library").answers["GET /api/recordings"] as readonly RecordingInfo[];
  if (info === undefined) throw new Error("no recording was recorded");
  const channel = (id: number, name: string, sent_unit = ""): object => {
    return { id, name, title: "", unit: "m/s²", device: "1", group: "", columns: [{ sent_unit }] };
  };
  const detail = {
    info,
    devices: [{ id: "1", name: "one" }],
    channels: [channel(1, "Acceleration"), channel(2, "Velocity", "mm/s")],
  } as unknown as RecordingDetail;
  capabilities.value = { absent: [], links: [], protocols: [], exports: [form("csv", "CSV"), form("mat", "MATLAB")] };
  const asked = answering({ "POST /api/recordings/yard/exports": job });
  const app = newApp();
  const { store } = app;
  const of = {
    info,
    detail,
    ranges: [{ name: "In view", t0: FIRST + 1, t1: FIRST + 3 }],
    first: FIRST,
    base: "device",
  } as const;
  render(<ExportDialog app={app} of={of} />);
  return { asked, store };
}
test("range, format and channels are chosen, shown and requested", async () => {
  const { asked, store } = open();
  const words = (): string => document.querySelector("dialog p")?.textContent ?? "";
  expect(words()).toContain("2 channels");
  fireEvent.click(screen.getByRole("button", { name: "In view" }));
  await waitFor(() => expect(words()).toMatch(/00:01.* to 00:03/));
  fireEvent.click(screen.getByRole("radio", { name: /MATLAB/ }));
  fireEvent.click(screen.getByRole("checkbox", { name: /Velocity/ }));
  await waitFor(() => expect(words()).toContain("1 channel"));
  fireEvent.click(screen.getByRole("button", { name: /^Export MATLAB/ }));
  await waitFor(() => expect(store.exports.value).toEqual([job]));
  expect(asked.find(({ path }) => path.endsWith("/exports"))?.body).toMatchObject({
    format: "mat",
    t0: FIRST + 1,
    t1: FIRST + 3,
    channels: [1],
    base: "device",
  });
  await waitFor(() => expect(screen.getByRole("progressbar")).toBeTruthy());
  const saved = vi.spyOn(HTMLAnchorElement.prototype, "click").mockImplementation(() => {});
  store.exports.value = [{ ...job, state: "done", size: 1_234_000, progress: 1 }];
  expect(saved.mock.instances).toMatchObject([{ download: job.file }]); // without a second press
  store.exports.value = [...store.exports.value];
  expect(saved).toHaveBeenCalledTimes(1);
  const link = await screen.findByRole("link", { name: "Download" });
  expect(link.getAttribute("download")).toBe(job.file);
});

test("without a channel nothing is exported", async () => {
  open();
  fireEvent.click(screen.getByRole("button", { name: "None" }));
  await waitFor(() =>
    expect(screen.getByRole<HTMLButtonElement>("button", { name: /^Export CSV/ }).disabled).toBe(true),
  );
});

test("a refused export says why in the dialog, over what is behind it", async () => {
  open();
  const refusal = { kind: "full", message: "The disk is full.", hint: "" };
  vi.stubGlobal("fetch", async () => Response.json(refusal, { status: 409 }));
  fireEvent.click(screen.getByRole("button", { name: /^Export CSV/ }));
  await waitFor(() => expect(document.querySelector("dialog .problem")?.textContent).toContain("The disk is full."));
});

test("tables are written in the units that are chosen, where that makes a difference", async () => {
  const { asked } = open();
  fireEvent.change(screen.getByRole("combobox", { name: "Units" }), { target: { value: "device" } });
  fireEvent.click(screen.getByRole("button", { name: /^Export CSV/ }));
  await waitFor(() => expect(asked.at(-1)?.body).toMatchObject({ units: "device" }));
  fireEvent.click(screen.getByRole("radio", { name: /MATLAB/ }));
  expect(screen.queryByRole("combobox", { name: "Units" })).toBeNull();
  const again = screen.getByRole<HTMLButtonElement>("button", { name: /^Export MATLAB/ });
  await waitFor(() => expect(again.disabled).toBe(false));
  fireEvent.click(again);
  await waitFor(() => expect(asked.at(-1)?.body).toMatchObject({ format: "mat", units: "shown" }));
});
