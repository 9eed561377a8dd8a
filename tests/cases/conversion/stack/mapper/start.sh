echo "mapping with $(cat /config/calibrated.yaml), master $(wget -q -O- $ROS_MASTER_URI/state)"
exec sleep 86400
