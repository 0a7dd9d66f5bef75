// @vitest-environment happy-dom
/** The 3D scene: a frame that is there on request only, beside the plots or as a panel of a workspace. */
import { fireEvent, render, screen, waitFor } from "@testing-library/preact";
import { expect, test, vi } from "vitest";
import { newApp, openPage } from "../../testing/live-page";
import { type Answers, recorded } from "../../testing/recorded";
import { ViewerButton } from "../../views/viewers";
import { Following } from "./scene-frame";
import { TEXT as WORKSPACE } from "../../texts/workspace";

const frames = (): readonly (string | null)[] =>
  [...document.querySelectorAll("iframe")].map((frame) => frame.getAttribute("src"));
const scenes: Answers = { "GET /api/views/scene": { address: "/viser/1/" } };

test("nothing of it is loaded before it is asked for, and nothing is left once it is closed", async () => {
  const { asked } = await openPage(recorded("xbus"), { answers: scenes });
  const requested = (): boolean => asked.some(({ path }) => path.startsWith("/api/views/scene"));
  await waitFor(() => expect(document.querySelector("[data-numeral]")).not.toBeNull());
  expect([frames(), requested()]).toEqual([[], false]);
  fireEvent.click(screen.getAllByRole("button", { name: "3D scene" })[0] as HTMLElement);
  await waitFor(() => expect(frames()).toEqual([expect.stringMatching(/^\/viser\/1\//)]));
  fireEvent.click(screen.getByRole("button", { name: "Close the 3D scene" }));
  await waitFor(() => expect(frames()).toEqual([]));
});

test("it is a panel of the workspace once a person shows it there", async () => {
  await openPage(recorded("xbus"), { answers: scenes });
  await waitFor(() => expect(document.querySelector("[data-panel=values]")).not.toBeNull());
  fireEvent.keyDown(document.body, { key: "w" });
  fireEvent.click(await screen.findByLabelText(WORKSPACE.showPanel("3D scene")));
  const panel = (): Element | null => document.querySelector("[data-panel=scene] iframe");
  await waitFor(() => expect(panel()?.getAttribute("src") ?? "").toMatch(/^\/viser\/1\//));
});

test("why there is no scene is said in its place", async () => {
  const problem = { kind: "missing", message: "viser is not installed.", hint: "Install it." };
  const refused = { "GET /api/views/scene": () => Response.json(problem, { status: 503 }) };
  await openPage(recorded("xbus"), { answers: refused });
  await waitFor(() => expect(document.querySelector("[data-numeral]")).not.toBeNull());
  fireEvent.click(screen.getAllByRole("button", { name: "3D scene" })[0] as HTMLElement);
  expect((await screen.findByText(/viser is not installed/)).closest("[role=alert]")?.textContent).toContain(
    "Install it.",
  );
});

test("of two pages in one document each opens a scene of its own", async () => {
  const [left, right] = [newApp(), newApp()];
  render([
    <ViewerButton key="left" app={left} isLive={false} />,
    <ViewerButton key="right" app={right} isLive={false} />,
  ]);
  const pressed = (): readonly (string | null)[] =>
    screen.getAllByRole("button", { name: "3D scene" }).map((button) => button.getAttribute("aria-pressed"));
  expect(pressed()).toEqual(["false", "false"]);
  fireEvent.click(screen.getAllByRole("button", { name: "3D scene" })[0] as HTMLElement);
  await waitFor(() => expect(pressed()).toEqual(["true", "false"]));
});

test("a scene of a recording opens again after the server was started again", async () => {
  const sockets: FakeSocket[] = [];
  class FakeSocket {
    onmessage: (event: { readonly data: string }) => void = () => undefined;
    onclose: ((event: { readonly reason: string }) => void) | null = null;
    readonly readyState = 0;
    constructor(readonly address: string) {
      sockets.push(this);
    }
    close(): void {}
  }
  vi.stubGlobal("WebSocket", FakeSocket);
  render(<Following player={{ recording: "yard", head: () => 0, rate: () => 0 }} />);
  await waitFor(() => expect(sockets).toHaveLength(1));
  sockets[0]?.onmessage({ data: JSON.stringify({ address: "/viser/replay-1/" }) });
  await waitFor(() => expect(frames()).toEqual([expect.stringMatching(/^\/viser\/replay-1\//)]));
  sockets[0]?.onclose?.({ reason: "" });
  expect((await screen.findByText(/has ended/)).closest("[role=alert]")?.textContent).toContain("opens again");
  await waitFor(() => expect(sockets).toHaveLength(2));
  sockets[1]?.onmessage({ data: JSON.stringify({ address: "/viser/replay-2/" }) });
  await waitFor(() => expect(frames()).toEqual([expect.stringMatching(/^\/viser\/replay-2\//)]));
  expect(sockets[1]?.address).toMatch(/\/ws\/scene\/yard$/);
});
