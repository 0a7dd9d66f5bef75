/** ROS 2: the topics of a device. */
import { registerExtension } from "../../extension/extension";
import type { DeviceActionProps } from "../../page/context";
import { Button } from "../../ui/controls/button";
import { late } from "../../ui/dom/late";
import { TEXT } from "./texts";

function TopicsButton({ app, device }: DeviceActionProps) {
  if (device.status !== "live") return null;
  return <Button look="small" words={TEXT.ros} onClick={() => (app.overlay.value = "ros2/topics")} />;
}

registerExtension({
  name: "ros2",
  views: [{ slot: "deviceActions", order: 20, View: TopicsButton }],
  dialogs: [{ overlay: "ros2/topics", Live: late(async () => (await import("./topics")).RosTopics) }],
});
