"""Gymnasium-Robotics' Fetch arm with scripted controllers."""
