// @vitest-environment happy-dom
/** The cell beside the attitude, and the track that it enlarges. */
import { fireEvent, screen, waitFor } from "@testing-library/preact";
import { expect, test } from "vitest";
import { openPage } from "../../testing/live-page";
import { recorded } from "../../testing/recorded";

test("position without set-up, and its track in a dialog", async () => {
  await openPage(recorded("isb"));
  const caption = (): string => document.querySelector(".gnss .caption")?.textContent ?? "";
  await waitFor(() => expect(caption()).toMatch(/3D · \d+ sat/));
  fireEvent.click(screen.getByRole("button", { name: /Enlarge the track/ }));
  await waitFor(() => expect(document.querySelector("dialog .track-summary")?.textContent).toMatch(/3D/));
});
