"""
A waveform generator and oscilloscopes that are told what to do in SCPI; nothing here knows ROS.

::

    dialect     what to tell and ask an instrument of a family, from params/scpi/dialects/
    words       samples as the binary words that cross the wire
    rates       which sample rate an oscilloscope takes, and what reading between samples costs
    settings    the bench: addresses, ranges, which quantity is where
    link        a connection: text, blocks, time-outs; `visa` makes one with PyVISA
    instrument  identification, error queue, faults that name instrument, command and value
    generator, oscilloscope   what the two do for a run
    bench       one run: upload, arm, trigger, wait, read
"""
