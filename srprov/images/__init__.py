"""Images: what a container definition becomes before anything is built.

Takes a ContainerDefinition and a way to read the files that it names; gives an ImagePlan: Dockerfile, build context
and content tag. Pure: what it needs done, `modules/image.py` says as resources.
"""
