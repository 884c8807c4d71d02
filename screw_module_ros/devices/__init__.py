# SPDX-License-Identifier: Apache-2.0
"""ROS-free drivers for what hangs on the CAN bus; units and byte orders end here.

bus, port         one CAN bus, one reader
sdo, node, pdo    CANopen (CiA 301): parameters, network management, cyclic objects
emcy, bus_load    names of emergencies; what the configured frames cost on the wire
ledger            which request an answer without a number belongs to
encoder           CiA 406 encoder of the screw
cia402, drive     CiA 402 state machine and drives
ati, force_sensor ATI NETCANOEM six-axis transducer
"""
