/** Stored workspaces: by name on the server, for a family, and as files. */
import { registerExtension, type Slots } from "../../extension/extension";
import { late } from "../../ui/dom/late";
import type { WorkspaceSession } from "../../workspace/session";

const StoredSection = late(async () => (await import("./stored-section")).StoredSection);

const StoredView = (properties: Slots["workspaceSheet"]) => <StoredSection {...properties} />;

async function openDefault(session: WorkspaceSession, family: string, isUntouched: () => boolean): Promise<void> {
  const stored = await import("./stored");
  await stored.openDefault(session, family, isUntouched);
}

registerExtension({
  name: "workspaces",
  views: [{ slot: "workspaceSheet", order: 10, View: StoredView }],
  workspaceDefaults: [openDefault],
});
