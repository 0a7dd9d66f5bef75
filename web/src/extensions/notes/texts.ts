/** Texts of the panel with the notes of a recording. */

export const TEXT = {
  title: "Notes",
  empty: "No notes yet.",
  edit: "Edit",
  write: "Write notes",
  label: "Notes of the recording",
  placeholder: "A time such as [14:32:18.500] leads there",
  insertTime: "Insert time",
  insertRange: "Insert A to B",
  insertHint: "Insert the time of the cursor, or with two cursors their range",
  save: "Save",
  cancel: "Cancel",
  changed: "These are the notes as they are now. Yours are above; combine them and save again.",
  noRecording: "Notes are stored with a recording. Start one with Record, or save the memory and open it.",
};
