# SPDX-License-Identifier: Apache-2.0
"""ROS-free drivers for the devices on the CAN bus; units and byte orders end here.

sdo, node, pdo      CANopen (CiA 301): parameters, network management, cyclic objects
emcy                names of emergencies
polled              one request per tick; request_tracker matches answers to requests
motion, unwrap      wrapping counts to position and velocity of nut and joints, homed on the host
encoder             CiA 406 encoder of the screw; encoder_setup
cia402, drive       CiA 402 state machine and drives; drive_setup configures drive and guards,
                    drive_logic decides the controlword, drive_reports decodes the drive's frames,
                    drive_exit shuts the drive down cleanly
ati, force_sensor   ATI NETCANOEM six-axis transducer: ati has its frame layouts; ati_dialogue, tare
"""
