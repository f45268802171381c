"""Scenes, rings, sensors and what is told wrong, drawn at random: where are errors larger than sigmas say?"""
