"""
Virtual instruments on sockets of their own, around the virtual motor: a laboratory without one.

They understand what generators and oscilloscopes of a few well-known families are told. Nothing
here comes from `nodes.scpi`: what one side gets wrong the other must notice.

::

    syntax        program messages into commands, as SCPI and IEEE 488.2 have them
    generator     virtual waveform generators
    oscilloscope  virtual oscilloscopes
    laboratory    what the voltage does to the motor, and what comes out of the transducers
    server        the sockets, and the faults that can be asked for; runnable
"""
