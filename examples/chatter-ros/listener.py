"""Print what is heard on /chatter, until SIGTERM or SIGINT (rospy handles both)."""

import rospy
from std_msgs.msg import String

rospy.init_node("listener")
rospy.Subscriber("/chatter", String, lambda message: print(f"heard: {message.data}", flush=True))
rospy.spin()
