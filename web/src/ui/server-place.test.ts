import { describe, expect, it } from "vitest";
import { robotHref, serverRoot, shownRobot } from "./server-place";

describe("the place of the server", () => {
  it("is this host, unless the page is that of a robot", () => {
    for (const path of ["/", "/robots", "/robots/", "/robots/a", "/docs/robots/a/"]) {
      expect(serverRoot(path)).toBe("");
      expect(shownRobot(path)).toBeUndefined();
    }
  });

  it("is found again in the address of a robot, whatever its name", () => {
    for (const name of ["otter-7", "Otter 7", "ö.1", "a%"]) {
      const path = robotHref(name, "configure").replace(/#.*/, "");
      expect(serverRoot(path)).toBe(`/robots/${encodeURIComponent(name)}`);
      expect(shownRobot(path)).toBe(name);
    }
    expect(shownRobot("/robots/%/")).toBe("%");
  });
});
