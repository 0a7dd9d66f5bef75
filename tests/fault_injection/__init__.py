"""Faults in operation and their outcomes: each fault is a test, and no data are lost.

Nothing lost: every sample that arrived is recorded and shown, or counted; nothing hangs; a person is told in one
sentence with a hint. Real pseudo-terminals, sockets, disks and server processes; the tables at the head of each file
say the outcomes. Where a fault was tested beside what it happens to, the test is named here.

    fault                                test (of this folder where none is named)
    device unplugged and back            test_links, server/devices/link/test_session (a_dead_link…),
                                         server/links/test_simulator (…is_unplugged…), browser/test_links (…pulled…)
    … under another name                 test_links
    baud changed under us                test_links; by ourselves: server/links/test_serial_reopened,
                                         server/configuration/test_rollback
    garbage for a minute                 test_links; server/links/test_baud_scan (noise at every rate), tests/fuzz
    half a frame then silence            test_links, server/devices/link/test_session (an_incomplete_frame…)
    device clock jump                    test_clocks, server/devices/link/test_session (a_clock_step…),
                                         server/devices/link/test_session_families
    host clock step                      test_clocks, server/devices/link/test_session (…wall_clock…)
    port held by another process         test_links, server/links/test_serial (a_port_in_use…), test_tcp_and_udp
    network gone and back                test_links, server/links/test_tcp_and_udp (reset, refused, no answer, replaced)
    disk full                            test_disk, recordings/mcap/test_live_writer, recordings/mcap/test_writer,
                                         server/library/test_recorder, server/configuration/test_rollback,
                                         server/configuration/test_snapshots
    memory limited                       test_memory, server/test_resource_limits (workers)
    disk slow                            test_disk, recordings/mcap/test_live_writer
    recording folder deleted             recordings/mcap/test_live_writer, server/library/test_recorder
    file corrupted at random bytes       test_disk, recordings/mcap/test_writer, recordings/library/test_library
    kill -9 while it records             test_kill, server/library/test_recorder (…20_ms, …packed_by_the_next)
    kill -9 while it writes settings     test_kill; with a rollback pending: server/configuration/test_rollback
    kill -9 while it exports             test_kill
    browser closed in a command          test_concurrent_users; with a rollback pending: browser/test_configure
    two people command at once           test_concurrent_users, server/api/test_configure,
                                         server/configuration/test_device_controller
    SIGTERM                              test_shutdown, server/library/test_recorder, server/test_cli,
                                         server/configuration/test_device_controller;
                                         within 2 s: tests/bench/shutdown.py
"""
