"""The workbench: a job as a form in the browser, beside the preview of its program.

- `session`: the open job and its history as a value
- `form`: the fields of the form
- `job_text`: the text of the job file
- `journal`: keeps changes that are not saved
- `perform`: builds a program, in the process of `builder`
- `desk`: keeps all pages of one session up to date
- `server`, `guard`: answer the requests of pages
"""
