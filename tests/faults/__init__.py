"""What fails on a robot, and what becomes of it then: each fault is a test with an outcome, and nothing is lost.

Nothing lost: every sample that arrived is recorded and shown, or counted; nothing hangs; a person is told in one
sentence with a hint. Real pseudo-terminals, sockets, disks and server processes; the tables at the head of each file
say the outcomes. Where a fault was tested beside what it happens to, the test is named here.

    fault                                test
    device unplugged and back            faults/test_links, server/test_session (a_dead_link…), links/test_twin
                                         (…is_unplugged…), browser/test_links (…pulled…)
    … under another name                 faults/test_links
    baud changed under us                faults/test_links; by ourselves: links/test_relink, server/test_trials
    garbage for a minute                 faults/test_links; links/test_scan (noise at every rate), tests/fuzz
    half a frame then silence            faults/test_links, server/test_session (an_incomplete_frame…)
    device clock jump                    faults/test_clocks, server/test_session (a_clock_step…), server/test_families
    host clock step                      faults/test_clocks, server/test_session (…wall_clock…)
    port held by another process         faults/test_links, links/test_serial (a_port_in_use…), links/test_network
    network gone and back                faults/test_links, links/test_network (reset, refused, no answer, replaced)
    disk full                            faults/test_disk, recordings/test_tape, recordings/test_container,
                                         server/test_recorder, server/test_trials, server/test_snapshots
    disk slow                            faults/test_disk, recordings/test_tape
    recording folder deleted             recordings/test_tape, server/test_recorder
    file corrupted at random bytes       faults/test_disk, recordings/test_container, recordings/test_library
    kill -9 while it records             faults/test_kill, server/test_recorder (…20_ms, …packed_by_the_next)
    kill -9 while it writes settings     faults/test_kill; on trial: server/test_trials
    kill -9 while it exports             faults/test_kill
    browser closed in a command          faults/test_people; of a trial: browser/test_configure
    two people command at once           faults/test_people, server/test_control, server/test_configure
    SIGTERM                              faults/test_ending, server/test_recorder, server/test_cli, server/test_control;
                                         within 2 s: tests/bench/shutdown.py
"""
