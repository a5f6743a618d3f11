"""What `build_addon.py` is made of, each module above those that it uses.

suites              the suites of tests, side by side
reports             what tests said, counted
packaging           the add-on as a zip
wheels              the wheel, and what else is built in its folder
other_debian        a newer Debian, for its Blender with a window
python_environment  .venv, another Python, and Blenders that come as Python packages
system              the system's packages
running             commands, their logs, and what was made from what
paths               where things lie
"""
