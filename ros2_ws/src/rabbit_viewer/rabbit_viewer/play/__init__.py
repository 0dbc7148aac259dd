"""`rabbit play`: a robot walks in another process, and a person plays with it in the browser.

`settings`: what can be chosen. `messages`: what a browser may ask. `walker`: one robot. `player`: all of them, in real
time. `learning`: a training next to it. `serving`: the processes and the page put together.
"""
