"""
Sets the environment of imotor_ros up on first use, with the standard library alone.

It runs on any Python from 3.8 on, before anything is installed, and knows nothing of `imotor_ros`.
What it makes is inside `.imotor/`, one folder per source of ROS:

    .imotor/wheels     ROS 2 Jazzy from Python wheels, in a virtual environment
    .imotor/sourced    a virtual environment over the ROS 2 Jazzy that the user has sourced

        venv/          the virtual environment
        overlay/       an ament prefix: `imotor_msgs` compiled, `imotor_ros` linked to the sources
        state.json     which step was done with which input: what a later start compares
        setup.log      everything the steps printed
        lock           held while a set-up runs

`__main__` decides in a few milliseconds whether all of this is up to date, and replaces itself
with the verb; only if it is not are the other modules imported.
"""
