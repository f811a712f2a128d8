"""Files as their makers lay them out: DataFlash, ULog, MATLAB, ROS bags, MCAP, NovAtel lines;
bounded reading.
"""
