"""Publish a greeting on /chatter twice a second, until SIGTERM or SIGINT (rospy handles both)."""

import socket

import rospy
from std_msgs.msg import String

rospy.init_node("talker")
chatter = rospy.Publisher("/chatter", String, queue_size=10)
rate = rospy.Rate(2)
number = 0
while not rospy.is_shutdown():
    number += 1
    text = f"hello from talker on {socket.gethostname()} #{number}"
    print(f"said: {text}", flush=True)
    try:
        chatter.publish(text)
        rate.sleep()
    except rospy.ROSException:  # the node is being shut down; ROSInterruptException is one too
        break
