"""Scenes from elsewhere: MoveIt's planning scenes and requests, and MotionBenchMaker's problems, as problem files.

Read `scene` first: what all formats say. `reading` chooses the reader of a file (`moveit_text`, `moveit_messages` or
`benchmark_problems`), and `robot` and `problem_fields` turn the scene into the fields of a problem file.
"""
