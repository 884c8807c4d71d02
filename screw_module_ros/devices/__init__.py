# SPDX-License-Identifier: Apache-2.0
"""ROS-free drivers for the devices on the CAN bus; units and byte orders end here.

sdo, node, pdo      CANopen (CiA 301): parameters, network management, cyclic objects
emcy                names of emergencies
polled              one request per tick; request_tracker matches answers to requests
motion, unwrap      wrapping counts to position and velocity of nut and joints, homed on the host
encoder             CiA 406 encoder of the screw; encoder_setup
cia402, drive       CiA 402 state machine and drives; drive_setup configures and guards,
                    drive_start starts, drive_logic decides, drive_reports listens, drive_exit
                    leaves cleanly
ati, force_sensor   ATI NETCANOEM six-axis transducer; ati_dialogue, tare
"""
