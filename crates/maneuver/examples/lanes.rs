fn main(){ maneuver::lane_probe(); }
