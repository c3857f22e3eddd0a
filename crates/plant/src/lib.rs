//! The physics: vehicles, rotors, battery, cameras and radio links; speaks device bytes.
