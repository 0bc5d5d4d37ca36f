"""The live view: a page in the browser that shows a scene as it renders and changes it.

docs/view.md says how it is used. `session` renders on a thread of its own, `server` passes messages
(`messages`) between it and pages; the extra `view` has what the server needs.
"""
