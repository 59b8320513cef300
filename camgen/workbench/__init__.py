"""The workbench: a job as a form in the browser, beside the page of what it makes.

``session`` holds what is open as a value, ``form`` what the form shows, ``job_text`` the job file. ``journal`` keeps
changes that are not saved. ``perform`` builds in the process of ``builder``, ``desk`` keeps the pages of one session
in step, ``server`` and ``guard`` are its door.
"""
