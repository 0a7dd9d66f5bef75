// @vitest-environment happy-dom
import { afterEach, beforeEach, describe, expect, it } from "vitest";
import { fleetRoot, robotHref, serverRoot, shownRobot } from "./server-place";

const page = document.documentElement.dataset;

beforeEach(() => void delete page["robot"]);
afterEach(() => void delete page["robot"]);

describe("the place of the server", () => {
  it("is the folder of the page, also below a path of a proxy", () => {
    const roots = { "/": "", "/live": "", "/imu/": "/imu", "/a/robots/b/": "/a/robots/b", blank: "" };
    for (const [path, root] of Object.entries(roots)) expect(serverRoot(path)).toBe(root);
    expect(shownRobot()).toBeUndefined();
  });

  it("is that of a robot where the fleet server says so", () => {
    expect(robotHref("Otter 7", "configure")).toBe(`${fleetRoot()}/robots/Otter%207/#/configure`);
    page["robot"] = "Otter 7";
    expect(shownRobot()).toBe("Otter 7");
  });
});
