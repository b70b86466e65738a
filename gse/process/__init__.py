"""What the process needs of Python and its libraries: its own packages, a quick start, little memory, safe output.

Nothing here knows of stars. Each module works around something, and buys this (CPU where it is not said otherwise,
interleaved with the program without it):

    own_packages        ours are imported, not another ``drivers``; 0.1 ms
    jit                 10 to 60 s of compilation at each start but the first; numba's own cache, told a folder for
                        exactly this program (of its own cache classes, which saved 0.05 s of identify's 0.7, none)
    installation        hashes of the source, by which machine code, kept results and a self-check know the program;
                        what is kept in its cache folder is this user's alone, or is not kept
    release_memory      a replay of 72,000 frames in 246 MiB; 306 without the first of its three places (after the
                        set-up, before judging, before drawing); 0.35 s and 47 MiB where pandas is installed, which
                        pyarrow else imports
    interrupts          Ctrl-C ends a command with 130, and never with a traceback, an internal error or signal 11: of
                        600 at random instants of a preflight, three did
    terminal            a terminal is never silent for more than a second; messages that nobody takes change no result;
                        a reader that is slow, stopped or gone never delays a session

``gse.__main__`` has four lines more: a threshold of the search for garbage (0 to 0.04 s of identify's 1.3, 0.2 to 0.7
of 3.2 of a replay), none at the end (0.03 to 0.5 s), short turns of threads (an answer goes out before what follows on
it), and one allocator with Arrow's.
"""
