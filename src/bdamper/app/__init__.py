"""The explorer: a page that answers while sliders move.

In: a study.  Out: a page on the loopback interface, in a browser or in a notebook, with its tracking curve, its optimal
curve, its contact faces and a hysteresis loop.  `answers` computes in a thread what the page asks, the newest question
first; `page` is what one window shows; `explorer` serves it.  Bokeh (the extra ``bdamper[app]``) is loaded when it is used.
"""
