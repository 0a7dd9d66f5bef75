"""Fuzzing of the decoders: random search that knows the frames.

    python -m tests.fuzz isb --minutes 10 [--seed 7]

    corpus ──> pieces (frames and what is between) ──> mutations.py ──> stream, cuts, settings     a case
       ^                                                                      │
       └── what showed something new ── features ── invariants.py <───────────┘
                                                        └── broken: minimised, kept in findings/<protocol>/*.hex

A case is a stream of bytes, where it is cut into chunks, and what the decoder is told (keys, modes). It is made from
golden vectors, captures and the simulators' streams by edits that know what a frame is: a bit turned, a length that
lies, a
payload that is hostile under a right checksum, frames cut, doubled, spliced and put into one another, sentences and
messages of others, noise. `invariants.py` says what must hold for every case; targets.py what each protocol adds.

Cases that show something new (a message, a reason, a pair of events not seen before) join the corpus, so the search
goes on from them. The same seed gives the same cases in the same order, whatever the machine's speed.

`findings/` keeps every input that ever broke something, with a sentence on what it showed; test_fuzz.py replays them
all, and runs a short burst, with every run of the tests. `runs.json` says how long each target has run.

What comes from outside is fuzzed by time: `python -m tests.fuzz http|ws|files --minutes 10` (external_inputs.py); its
findings and a few new cases are in test_outside.py.
"""
