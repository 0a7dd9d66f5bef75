// @vitest-environment happy-dom
/** Uploads to the store, in the library. */
import { fireEvent, waitFor } from "@testing-library/preact";
import { expect, test, vi } from "vitest";
import { newApp, openPage } from "../../../testing/live-page";
import { find } from "../../../testing/queries";
import { answering, recorded } from "../../../testing/recorded";
import { uploadsOf } from "./marks";

const rows = (): readonly HTMLElement[] => [...document.querySelectorAll<HTMLElement>(".recording-list tbody tr")];

test("a recording tells the state of its upload and why it is refused", async () => {
  const upload = { id: "yard", state: "refused", reason: "It has the tag private.", progress: 0, stored_at: null };
  const uploads = { enabled: true, store: "/srv", robot: "otter", problem: "", recordings: [upload] };
  await openPage(recorded("library"), { place: "#/recordings", answers: { "GET /api/uploads": uploads } });
  await waitFor(() => expect(rows()[0]?.textContent).toContain("Not uploaded · "));
  const [row] = rows();
  if (row) fireEvent.click(row);
  await waitFor(() => expect(find(".upload-facts").textContent).toContain("It has the tag private."));
});

test("without a store nothing is said of uploads", async () => {
  const uploads = { enabled: false, store: "", robot: "", problem: "", recordings: [] };
  const answers = { "GET /api/uploads": uploads };
  const { asked } = await openPage(recorded("library"), { place: "#/recordings", answers });
  await waitFor(() => expect(asked.some(({ path }) => path === "/api/uploads")).toBe(true));
  await waitFor(() => expect(rows().length).toBe(1));
  expect(document.querySelector(".upload-mark")).toBeNull();
});

test("an upload is followed further after a question without an answer", async () => {
  vi.useFakeTimers();
  const upload = { id: "yard", state: "uploading", reason: "", progress: 0.4, stored_at: null };
  const answers = [
    () => ({ recordings: [upload] }),
    () => new Response("", { status: 502 }),
    () => ({ recordings: [{ ...upload, state: "stored" }] }),
  ];
  answering({ "GET /api/uploads": () => answers.shift()?.() });
  const app = newApp();
  app.store.receive({ kind: "connection", state: "open", nextTry: undefined });
  const uploads = uploadsOf(app);
  const stop = uploads.follow();
  await vi.advanceTimersByTimeAsync(100);
  expect(uploads.known.value.get("yard")?.state).toBe("uploading");
  await vi.advanceTimersByTimeAsync(7000);
  expect(uploads.known.value.get("yard")?.state).toBe("stored");
  stop();
  vi.useRealTimers();
});
