"""Files that are not read, by their first bytes: what they are, and what to do with them."""

from dataclasses import dataclass

UNPACK = "Unpack it, and give a file of it."
OTHER = "Give the file with the samples of the sensor."


@dataclass(frozen=True, slots=True)
class KnownFile:
    """A format that is not read.

    Args:
        name: with its article: "a PNG image".
        remedy: one sentence.
        marks: first bytes, any of them.
        offset: of the marks.
        suffixes: of its files, if they have no marks.
        frame: first byte of its frames, and their length, if they are all of one.
        may_be_table: whether a table can begin like that.
    """

    name: str
    remedy: str
    marks: tuple[bytes, ...] = ()
    offset: int = 0
    suffixes: tuple[str, ...] = ()
    frame: tuple[int, int] | None = None
    may_be_table: bool = False

    def has_frames(self, head: bytes) -> bool:
        """Whether the first bytes of a file are several frames of this format."""
        if self.frame is None:
            return False
        first, length = self.frame
        begins = head[::length]
        is_mark = head.count(first) < 2 * len(begins)  # not what all bytes are
        return is_mark and len(begins) >= FEWEST_FRAMES and begins == bytes([first]) * len(begins)


FEWEST_FRAMES = 8
LONGEST_CHARACTER = 4  # bytes in UTF-8
_CONTROLS = {chr(one) for one in range(32)} - set("\t\n\r\f\x1b")
AS_CANDUMP = "Convert it to the text of candump, for instance with python -m can.logconvert IN OUT.log."
AS_SAVED_CANDUMP = "Save it with SavvyCAN as a log of candump."
AS_TEXT = "Give the text file that its program makes of it."
FILES = (
    KnownFile("a PNG image", OTHER, (b"\x89PNG\r\n\x1a\n",)),
    KnownFile("a JPEG image", OTHER, (b"\xff\xd8\xff",)),
    KnownFile("a GIF image", OTHER, (b"GIF87a", b"GIF89a")),
    KnownFile("a video or an image", OTHER, (b"ftyp",), 4),
    KnownFile("a RIFF file (AVI, WAV or WebP)", OTHER, (b"RIFF",)),
    KnownFile("a PDF document", "Give the numbers themselves, as a CSV file.", (b"%PDF-",)),
    KnownFile(
        "a spreadsheet or document of an older Office", "Save it as CSV.", (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1",)
    ),
    KnownFile(
        "a NetCDF file", "Write its variables as CSV or Parquet, for instance with xarray.", (b"CDF\x01", b"CDF\x02")
    ),
    KnownFile(
        "the text of rostopic echo",
        "Write it with rostopic echo -p or ros2 topic echo --csv, or give the bag.",
        (b"header:\n", b"header: \n", b"header:\r\n", b"---\nheader:"),
    ),
    KnownFile("a Rerun recording", "Give the recording that it was made of.", (b"RRF2", b"RRF0", b"RRIO")),
    KnownFile("an RF64 or W64 audio file", OTHER, (b"RF64", b"riff\x2e\x91")),
    KnownFile("a 7-Zip archive", UNPACK, (b"7z\xbc\xaf\x27\x1c",)),
    KnownFile("a RAR archive", UNPACK, (b"Rar!\x1a\x07",)),
    KnownFile("an xz archive", UNPACK, (b"\xfd7zXZ\x00",)),
    KnownFile("a tar archive", UNPACK, (b"ustar",), 257),
    KnownFile("a bzip2 archive", UNPACK, (b"BZh",)),
    KnownFile("an lz4 archive", UNPACK, (b"\x04\x22\x4d\x18",)),
    KnownFile("a program", OTHER, (b"\x7fELF", b"MZ\x90\x00")),
    KnownFile(
        "a Python pickle",
        "Save the arrays with numpy.savez: a pickle can run programs.",
        (b"\x80\x04\x95", b"\x80\x05\x95", b"\x80\x03"),
    ),
    KnownFile(
        "a web page or an XML file", "Give the numbers themselves, as a CSV file.", (b"<!DOCTYPE", b"<html", b"<?xml")
    ),
    KnownFile(
        "a packet capture of a network",
        "Save the payload of the stream as a file.",
        (b"\xd4\xc3\xb2\xa1", b"\xa1\xb2\xc3\xd4", b"\x0a\x0d\x0d\x0a"),
    ),
    KnownFile("a CAN log of Vector (BLF)", AS_CANDUMP, (b"LOGG\x90\x00\x00\x00",)),
    KnownFile("a CAN trace of PEAK (TRC)", AS_CANDUMP, (b";$FILEVERSION", b";##########", b";---+--")),
    KnownFile("a CAN log of SavvyCAN (GVRET)", AS_SAVED_CANDUMP, (b"Time Stamp,ID,Extended,",)),
    KnownFile("a CAN log of python-can", AS_CANDUMP, (b"timestamp,arbitration_id,extended,",)),
    KnownFile("an Avro file", "Write it as Parquet or CSV.", (b"Obj\x01",)),
    KnownFile(
        "a measurement of LabVIEW (TDMS)", "Write its channels as CSV, for instance with npTDMS.", (b"TDSm", b"TDSh")
    ),
    KnownFile("a recording of Lab Streaming Layer (XDF)", "Write its streams as CSV, with pyxdf.", (b"XDF:",)),
    KnownFile(
        "a binary log of NovAtel", "Convert it to ASCII with NovAtel Convert.", (b"\xaa\x44\x12", b"\xaa\x44\x13")
    ),
    KnownFile("a binary log of Septentrio (SBF)", "Convert it to CSV or NMEA with SBF Converter.", (b"$@",)),
    KnownFile(
        "an ASAM measurement (MDF)",
        "Write its channels as CSV or Parquet, for instance with asammdf.",
        (b"MDF     ", b"UnFinMF "),
    ),
    KnownFile(
        "a pointer of Git LFS instead of the file", "Fetch the file with git lfs pull.", (b"version https://git-lfs",)
    ),
    KnownFile("a bag of an old ROS 1", "Migrate it with rosbag fix.", (b"#ROSBAG V1", b"#ROSRECORD V1")),
    KnownFile("a LAS point cloud", OTHER, (b"LASF",)),
    KnownFile(
        "a text log of ArduPilot", "Give the .BIN file, or the CSV file of mavlogdump.", (b"FMT, 128,", b"FMT,128,")
    ),
    KnownFile(
        "a telemetry log of MAVLink",
        "Convert it with mavlogdump --format csv, and give the CSV file.",
        suffixes=(".tlog",),
    ),
    KnownFile("a FIT file", "Convert it to CSV, with a column for each field.", (b".FIT",), 8),
    KnownFile(
        "a text in brackets, but not JSON",
        "Give its samples as JSON or as a CSV file.",
        (b"{", b"[{", b"[\n"),
        may_be_table=True,
    ),
    *(KnownFile("a binary log of WitMotion", AS_TEXT, frame=(0x55, length)) for length in (11, 20, 28)),
    KnownFile(
        "the table of contents of a ROS 2 bag",
        "Give its folder, or the .db3 or .mcap file beside it.",
        (b"rosbag2_bagfile_information:",),
    ),
    KnownFile("a temporary file of SQLite", "Give the .db3 file beside it.", suffixes=(".db3-shm", ".db3-wal")),
    KnownFile("an Excel workbook", "Save it as CSV.", suffixes=(".xlsx", ".xls", ".ods")),
)


def seeming(data: bytes) -> str:
    """A sentence on the first bytes of a file of no known format, and what to do."""
    if len(set(data)) == 1:
        return f"All its bytes are {data[0]}, as after a copy that failed: copy it again."
    if is_plain_text(data):
        return "It is a text without rows of numbers: give those."
    return "It is binary, without a mark that is known: numbers alone can be saved with numpy.save, or as CSV."


def is_plain_text(data: bytes) -> bool:
    """Whether the first bytes of a file are those of a text."""
    try:
        text = data.decode()
    except UnicodeDecodeError as error:
        text = data[: error.start].decode() if len(data) - error.start < LONGEST_CHARACTER else ""
    return bool(text) and not any(one in _CONTROLS for one in text)


def known_file(head: bytes, suffix: str = "") -> KnownFile | None:
    return next(
        (
            one
            for one in FILES
            if any(head.startswith(mark, one.offset) for mark in one.marks)
            or suffix in one.suffixes
            or one.has_frames(head)
        ),
        None,
    )
