/** Names of the pages of a fleet server, and texts of a robot's page there. Those of its own pages are loaded with them. */
export const TEXT = {
  fleet: "Fleet",
  questions: "Questions",

  line: "Line to the robot",
  through: "through the fleet server",
  hint: "The robot answers these requests itself, with its own checks. Temporary changes are rolled back by the robot, even if the line is lost.",
  roundTrip: "Round trip",
  roundTripHint: "From this page to the robot and back, measured every 5 s",
};
