"""A ROS 2 robot: what its graph puts on Zenoh becomes the sensors' topics, and ``command/safe`` its ``cmd_vel``.

* ``settings``: which of the graph's topics is which of ours.
* ``names``, ``qos``, ``attachment``, ``types``: how ``rmw_zenoh`` and ``zenoh-bridge-ros2dds`` name and encode things.
* ``graph``: a node of that graph on a Zenoh session of its own; ``graph_cache``: who else is in it.
* ``pairs``, ``pace``, ``cameras``, ``inputs``: ROS's messages as ours; ``command``, ``outputs``: ours as ROS's.
* ``driver``: joins the graph and starts a thread for each side: ``motion``, ``vision``, ``scans``, ``telling``.
"""
