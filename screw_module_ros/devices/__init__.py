# SPDX-License-Identifier: Apache-2.0
"""ROS-free drivers for the devices on the CAN bus; units and byte orders end here.

canopen, sdo, pdo   what CANopen devices share (CiA 301): life cycle, parameters, cyclic objects
emcy                names of emergencies
polled              one request and one answer per tick
motion              wrapping counts to position and velocity of nut and joints, homed on the host
doubt               of two references that differ (homings, tares) neither counts at once
encoder             CiA 406 encoder of the screw; encoder_setup
drive               CiA 402 drives: drive_setup configures, drive_guards is what stops them by
                    themselves, drive_logic decides, cia402 is the state machine, drive_reports
                    decodes, drive_group starts and leaves
life                how far a device has come, and what it needs; base of all drivers
force_base          what every force sensor does alike; tare is its zero
force_frames        one on CAN that answers one frame with several
netcanoem           ATI NETCANOEM six-axis transducer; ati is its protocol
ati_net             ATI Net F/T box: the same sensor by plain CAN
force_sensors       which driver speaks with which, also of other packages
"""
