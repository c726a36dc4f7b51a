"""Fields of the tool with which the maker's adapter (R-Link) sets an AK drive: its page
"Application Settings".

The words are those of users who describe the page; they were not compared with the tool.
"""

CAN_ID = "CAN ID"
BITRATE = "CAN bitrate"
MIT_MODE = "MIT mode"
SERVO_MODE = "servo mode"
PERIODIC = "CAN mode: periodic feedback"
FEEDBACK_RATE = "CAN feedback rate"
